"""Both tasks with a trained model: a motion on a given body, and on bodies of the model's own."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pacmo_core.data.interaction import Interaction
from pacmo_core.skeleton_prior.data import (
    canonical_frame,
    interpolate_keyframes,
    is_b_first,
    keyframe_indices,
    scales_by_joint,
    stack_characters,
)
from pacmo_core.skeleton_prior.vae import SkeletonPrior

BATCH_SIZE = 32


def retarget(
    model: SkeletonPrior,
    source: Interaction,
    scales: NDArray[np.float64],
    *,
    samples: int,
    random: torch.Generator | None,
) -> Iterator[list[Interaction]]:
    """Give a source the bodies asked for, in their order: so many samples of each.

    Parameters
    ----------
    scales : (V, 2, E), of person a's bones and person b's, positive; within the training's range
        or not
    samples : at least 1
    random : draws the latents; none, they are at their mean, and all samples of a body alike

    Raises
    ------
    ValueError
        If the skeleton is not the model's, or scales or samples are not as described.
    """
    _check(model, source, scales, samples)
    repeated, made = np.repeat(scales, samples, axis=0), list[Interaction]()
    for row in range(0, len(repeated), BATCH_SIZE):
        made += _retarget_batch(model, source, repeated[row : row + BATCH_SIZE], random)
        while len(made) >= samples:
            yield made[:samples]
            made = made[samples:]


def _retarget_batch(
    model: SkeletonPrior,
    source: Interaction,
    scales: NDArray[np.float64],
    random: torch.Generator | None,
) -> list[Interaction]:
    """Give a source the bodies asked for in one pass for each order of the characters."""
    frame = canonical_frame(source)
    stride = max(1, round(model.config.stride * source.fps / model.config.fps))
    shape = (len(scales), len(source.times), 2, len(source.skeleton.joints), 3)
    placed = np.zeros(shape, dtype=np.float32)
    for b_first in (False, True):
        rows = [i for i, own in enumerate(scales) if is_b_first(own) == b_first]
        if rows:
            template = stack_characters(source, frame, b_first=b_first)
            own = scales_by_joint(scales[rows], source.skeleton)
            own = own.flip(1) if b_first else own
            motions = retarget_positions(model, template, own, random, stride=stride)
            placed[rows] = (motions.flip(2) if b_first else motions).numpy()
    return [
        replace(
            source,
            person_a=np.ascontiguousarray(both[:, 0]),
            person_b=np.ascontiguousarray(both[:, 1]),
        )
        for both in frame.to_world(placed)
    ]


def generate_skeletons(
    model: SkeletonPrior, n: int, *, random: torch.Generator
) -> NDArray[np.float64]:
    """Draw scales from the prior of bodies: of person b, person a's at 1.

    Returns
    -------
    (n, 2, E), for ``retarget``
    """
    with torch.no_grad():
        drawn = model.bodies.sample(n, random).cpu().double().numpy()
    scales = np.ones((n, 2, len(model.config.skeleton.bones)))
    scales[:, 1] = drawn[:, model.config.skeleton.bones[:, 1]]
    return scales


def retarget_positions(
    model: SkeletonPrior,
    template: Tensor,
    scales: Tensor,
    random: torch.Generator | None,
    *,
    stride: int,
) -> Tensor:
    """Vary one template in all ways at once, at its own rate.

    Parameters
    ----------
    template : (T, 2, J, 3), metres, the first character first
    scales : (V, 2, J)
    stride : frames from one that the networks see to the next

    Returns
    -------
    (V, T, 2, J, 3), metres, on the CPU
    """
    device, n_frames = model.unit.device, len(template)
    with torch.inference_mode():
        own = scales.to(device)
        whole = template.to(device).expand(len(scales), *template.shape)
        seen = whole[:, list(keyframe_indices(n_frames, stride))]
        fields = model.fields(seen, own, model.latents(seen, own, random))
        first, second = (interpolate_keyframes(field, n_frames, stride) for field in fields)
        return model.place((first, second), whole, own).cpu()


def _check(
    model: SkeletonPrior, source: Interaction, scales: NDArray[np.float64], samples: int
) -> None:
    skeleton = model.config.skeleton
    if (source.skeleton.joints, source.skeleton.parents) != (skeleton.joints, skeleton.parents):
        raise ValueError(
            f"the model varies skeleton {skeleton.name} of {len(skeleton.joints)} joints; "
            f"got {source.skeleton.name} of {len(source.skeleton.joints)}"
        )
    wanted = (2, len(skeleton.bones))
    if scales.ndim != 3 or scales.shape[1:] != wanted:
        raise ValueError(f"scales must be (V, {wanted[0]}, {wanted[1]}); got {scales.shape}")
    if not (np.isfinite(scales) & (scales > 0)).all():
        row, person, bone = np.argwhere(~(np.isfinite(scales) & (scales > 0)))[0]
        raise ValueError(
            f"scales must be positive and finite; body {row}, person {'ab'[person]}, bone {bone} "
            f"has {scales[row, person, bone]}"
        )
    if samples < 1:
        raise ValueError(f"samples must be at least 1; got {samples}")
