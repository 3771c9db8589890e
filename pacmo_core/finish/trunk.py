"""Shape of the trunk: hips, spine, shoulders and head of a reaction lie as those of people do.

A generator's error of a centimetre or two in every joint is small against a step and large against
a pelvis: hips swing about the root by 30 degrees, spines kink, the head sinks. The joints of the
trunk, turned and scaled to one frame, are nearly normally distributed, in generated as in captured
motion. The linear map that takes the one normal distribution to the other at least cost (Olkin and
Pukelsheim 1982; Peyre and Cuturi 2019, *Computational optimal transport*, remark 2.31) shrinks the
directions in which a trunk is rigid and keeps those in which it bends. The place, size and heading
of each trunk stay.
"""

from collections.abc import Iterable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.segments import segments
from pacmo_core.data.skeleton import Skeleton

Array = NDArray[np.float64]

MIN_JOINTS = 4  # of a trunk, of which a frame can be found
MIN_FRAMES_PER_DIMENSION = 10  # of which a covariance is learnt
SPREAD = 0.01  # of the trunk's size: standard deviation that is added to both distributions
N_ALIGNMENTS = 3  # until the mean shape does not change


@lru_cache(maxsize=8)
def trunk_joints(skeleton: Skeleton) -> tuple[int, ...]:
    """List the root and the joints of spine, head, hips and shoulders; none of unnamed limbs."""
    ends = dict(zip(skeleton.bones[:, 1].tolist(), segments(skeleton), strict=True))
    joints = [j for j in range(len(skeleton.joints)) if j not in ends or ends[j].part == "trunk"]
    return tuple(joints) if MIN_JOINTS <= len(joints) < len(skeleton.joints) else ()


def unshaped(skeleton: Skeleton) -> Array:
    """``(D + 2, D)``: the model of a trunk that changes none; D is 3 for each of its joints."""
    dimensions = 3 * len(trunk_joints(skeleton))
    return np.zeros((dimensions + 2, dimensions))


def trunk_size(motion: Array, skeleton: Skeleton) -> float:
    """Metres: root mean square distance of a trunk from its centre; 1 of a body without."""
    joints = motion[:, list(trunk_joints(skeleton))]
    if not joints.size:
        return 1.0
    offsets = joints - joints.mean(axis=1, keepdims=True)
    return float(np.median(np.sqrt((offsets**2).sum(axis=-1).mean(axis=1))))


def learn_trunk(pairs: Iterable[tuple[Array, Array]], skeleton: Skeleton) -> Array:
    """Learn the map from shapes of generated trunks to those of captured ones.

    Parameters
    ----------
    pairs : (T, J, 3) metres, of a generated motion, and of the captured reaction to the same
        partner
    skeleton : of both

    Returns
    -------
    (D + 2, D): the means of generated and of captured shapes, then the map of deviations from them
    """
    both, joints = list(pairs), list(trunk_joints(skeleton))
    n_frames = sum(len(generated) for generated, _ in both)
    if not joints or n_frames < MIN_FRAMES_PER_DIMENSION * 3 * len(joints):
        return unshaped(skeleton)
    generated, captured = (
        np.concatenate([motion[:, joints] / trunk_size(motion, skeleton) for motion in motions])
        for motions in zip(*both, strict=True)
    )
    mean = captured[0] - captured[0].mean(axis=0)
    for _ in range(N_ALIGNMENTS):
        mean = _aligned(captured, mean).mean(axis=0)
    drawn, seen = (
        _aligned(shapes, mean).reshape(len(shapes), -1) for shapes in (generated, captured)
    )
    noise = SPREAD**2 * np.eye(drawn.shape[1])
    root = _square_root(np.cov(drawn.T) + noise)
    inverse = np.linalg.inv(root)
    transport = inverse @ _square_root(root @ (np.cov(seen.T) + noise) @ root) @ inverse
    return np.vstack([drawn.mean(axis=0), seen.mean(axis=0), transport])


def shape_trunk(
    motion: Array, skeleton: Skeleton, trunk_model: Array, size: float | None = None
) -> Array:
    """Give trunks the shapes of captured ones; limbs stay.

    Parameters
    ----------
    motion : (T, J, 3) metres
    skeleton : of the motion
    trunk_model : of ``learn_trunk``
    size : metres, of ``trunk_size``; None for that of the motion

    Returns
    -------
    (T, J, 3) metres
    """
    if not trunk_model.any():
        return motion
    joints, (drawn, seen, transport) = list(trunk_joints(skeleton)), np.split(trunk_model, [1, 2])
    size = trunk_size(motion, skeleton) if size is None else size
    trunk, mean = motion[:, joints] / size, seen.reshape(-1, 3)
    turns, centres = _turns(trunk, mean), trunk.mean(axis=1, keepdims=True)
    shape = ((trunk - centres) @ turns).reshape(len(trunk), -1)
    shape = (seen + (shape - drawn) @ transport).reshape(trunk.shape)
    result = motion.copy()
    result[:, joints] = size * (centres + shape @ turns.swapaxes(1, 2))
    return result


def _aligned(trunks: Array, mean: Array) -> Array:
    """Shift and turn trunks ``(T, K, 3)`` so that they lie on a shape ``(K, 3)``."""
    return np.asarray((trunks - trunks.mean(axis=1, keepdims=True)) @ _turns(trunks, mean))


def _turns(trunks: Array, mean: Array) -> Array:
    """``(T, 3, 3)``: factors on the right that turn trunks to a shape (Kabsch 1976)."""
    centred = trunks - trunks.mean(axis=1, keepdims=True)
    left, _, right = np.linalg.svd(np.einsum("tki,kj->tij", centred, mean))
    left[:, :, 2] *= np.sign(np.linalg.det(left @ right))[:, None]
    return np.asarray(left @ right)


def _square_root(matrix: Array) -> Array:
    """Return the root of a symmetric positive matrix."""
    values, vectors = np.linalg.eigh(matrix)
    return np.asarray((vectors * np.sqrt(np.maximum(values, 0))) @ vectors.T)
