"""Inference with a trained skeleton prior: retarget to given skeletons, or to sampled ones."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pacmo_core.data.interaction import Interaction
from pacmo_core.interaction_mesh import Scene, Support
from pacmo_core.interaction_mesh.mesh import ground_supports
from pacmo_core.skeleton_prior.data import (
    canonical_frame,
    interpolate_keyframes,
    is_b_first,
    keyframe_indices,
    scales_by_joint,
    stack_characters,
)
from pacmo_core.skeleton_prior.finish import Finish
from pacmo_core.skeleton_prior.vae import SkeletonPrior

BATCH_SIZE = 32
MAX_TEMPERATURE = 2.0
Decode = Callable[[Tensor, Tensor], tuple[Tensor, Tensor]]
# What the solver takes for support by default (``augment.solver.support``).
SUPPORT = Support(max_height=0.2, height_tolerance=0.03, max_speed=0.2, fade_time=0.25)


def retarget(  # noqa: PLR0913  # each is a choice of the caller
    model: SkeletonPrior,
    source: Interaction,
    scales: NDArray[np.float64],
    *,
    samples: int,
    random: torch.Generator | None,
    temperature: float = 1.0,
    finish: bool = False,
) -> Iterator[list[Interaction]]:
    """Retarget a source to each of V pairs of skeletons, in order; yield the samples of each.

    Parameters
    ----------
    scales : (V, 2, E), of the bones of person a and person b, positive; may lie outside the range
        of the training data
    samples : of each pair of skeletons, at least 1
    random : samples the latents; without it the latents are the prior's mean, and all samples equal
    temperature : standard deviation of the latents, 0 to 2: below 1 samples are more alike
    finish : set right what the model leaves of angles, feet and touches (``finish``), if its output
        has exact bone lengths; the comparisons of models are of what they give without it

    Raises
    ------
    ValueError
        If the skeleton is not the model's, or scales, samples or temperature are not as described.
    """
    _check(model, source, scales, samples)
    if not 0 <= temperature <= MAX_TEMPERATURE:
        raise ValueError(f"temperature must be 0 to {MAX_TEMPERATURE:g}; got {temperature:g}")
    decode = partial(model.decode, random=random, temperature=temperature)
    repeated, pending = np.repeat(scales, samples, axis=0), list[Interaction]()
    for first in range(0, len(repeated), BATCH_SIZE):
        rows = repeated[first : first + BATCH_SIZE]
        pending += _retarget_batch(model, source, rows, decode, finish=finish)
        while len(pending) >= samples:
            yield pending[:samples]
            pending = pending[samples:]


def _retarget_batch(
    model: SkeletonPrior,
    source: Interaction,
    scales: NDArray[np.float64],
    decode: Decode,
    *,
    finish: bool,
) -> list[Interaction]:
    """Retarget to all skeletons at once, in one pass for each order of the characters."""
    frame = canonical_frame(source)
    stride = max(1, round(model.config.frame_stride * source.fps / model.config.fps))
    shape = (len(scales), len(source.times), 2, len(source.skeleton.joints), 3)
    positions = np.zeros(shape, dtype=np.float32)
    for b_first in (False, True):
        rows = [i for i, pair in enumerate(scales) if is_b_first(pair) == b_first]
        if rows:
            template = stack_characters(source, frame, b_first=b_first)
            joint_scales = scales_by_joint(scales[rows], source.skeleton)
            joint_scales = joint_scales.flip(1) if b_first else joint_scales
            motions = retarget_positions(model, template, joint_scales, decode, stride=stride)
            positions[rows] = (motions.flip(2) if b_first else motions).numpy()
    if finish and model.first.has_exact_bones:
        positions = _finished(model, source, torch.from_numpy(positions), scales)
    return [
        replace(
            source,
            person_a=np.ascontiguousarray(both[:, 0]),
            person_b=np.ascontiguousarray(both[:, 1]),
        )
        for both in frame.to_world(positions)
    ]


def _finished(
    model: SkeletonPrior, source: Interaction, positions: Tensor, scales: NDArray[np.float64]
) -> NDArray[np.float32]:
    """Finish positions (V, T, 2, J, 3) in the canonical frame, of person a and person b."""
    config = model.config
    both = stack_characters(source, canonical_frame(source), b_first=False)
    finish = Finish(config.skeleton, config.limbs, both, find_supports(source), source.fps)
    finished: NDArray[np.float32] = finish(
        positions, scales_by_joint(scales, source.skeleton)
    ).numpy()
    return finished


def find_supports(source: Interaction) -> NDArray[np.bool_]:
    """Find which joints support person a and person b in each frame, (T, 2, J)."""
    scene = Scene((source.person_a, source.person_b), (source.skeleton,) * 2, source.fps)
    return ground_supports(scene, SUPPORT).reshape(len(source.times), 2, -1)


def generate_skeletons(
    model: SkeletonPrior, n: int, *, random: torch.Generator
) -> NDArray[np.float64]:
    """Sample scales of person b from the skeleton VAE's prior; person a's are 1.

    Returns
    -------
    (n, 2, E), for ``retarget``
    """
    with torch.no_grad():
        sampled = model.skeleton_vae.sample(n, random).cpu().double().numpy()
    scales = np.ones((n, 2, len(model.config.skeleton.bones)))
    scales[:, 1] = sampled[:, model.config.skeleton.bones[:, 1]]
    return scales


def retarget_positions(
    model: SkeletonPrior,
    template: Tensor,
    scales: Tensor,
    decode: Decode,
    *,
    stride: int,
) -> Tensor:
    """Retarget one template to V pairs of skeletons, at the template's frame rate.

    Parameters
    ----------
    template : (T, 2, J, 3), metres, the first character first
    scales : (V, 2, J)
    decode : ``model.decode`` with its latents
    stride : frames between keyframes

    Returns
    -------
    (V, T, 2, J, 3), metres, on the CPU
    """
    device, n_frames = model.displacement_scale.device, len(template)
    with torch.inference_mode():
        scales = scales.to(device)
        templates = template.to(device).expand(len(scales), *template.shape)
        keyframes = templates[:, list(keyframe_indices(n_frames, stride))]
        outputs = decode(keyframes, scales)
        first, second = (interpolate_keyframes(output, n_frames, stride) for output in outputs)
        return model.joint_positions((first, second), templates, scales).cpu()


def _check(
    model: SkeletonPrior, source: Interaction, scales: NDArray[np.float64], samples: int
) -> None:
    skeleton = model.config.skeleton
    if (source.skeleton.joints, source.skeleton.parents) != (skeleton.joints, skeleton.parents):
        raise ValueError(
            f"the model's skeleton is {skeleton.name} of {len(skeleton.joints)} joints; "
            f"got {source.skeleton.name} of {len(source.skeleton.joints)}"
        )
    shape = (2, len(skeleton.bones))
    if scales.ndim != 3 or scales.shape[1:] != shape:
        raise ValueError(f"scales must be (V, {shape[0]}, {shape[1]}); got {scales.shape}")
    if not (np.isfinite(scales) & (scales > 0)).all():
        row, person, bone = np.argwhere(~(np.isfinite(scales) & (scales > 0)))[0]
        raise ValueError(
            f"scales must be positive and finite; row {row}, person {'ab'[person]}, bone {bone} "
            f"is {scales[row, person, bone]}"
        )
    if samples < 1:
        raise ValueError(f"samples must be at least 1; got {samples}")
