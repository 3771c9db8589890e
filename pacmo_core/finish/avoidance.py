"""Collision avoidance: a body that goes through the partner goes round them.

A generator that does not know what the partner does may put a body where they are. Where the
middles of the trunks are much nearer to each other, over the floor, than those of any captured
people, the path of the body about the partner is pushed out to where captured people are at least,
and smoothed, in turn, like an elastic band about a pole. The body moves as a whole; feet that slide
then take steps.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, maximum_filter1d

from pacmo_core.data.interaction import Motion
from pacmo_core.data.segments import trunk_pairs
from pacmo_core.data.skeleton import Skeleton

Array = NDArray[np.float64]

# Share of the least distance of captured trunks, within which a body is in the partner: others may
# embrace a little more closely.
INSIDE = 0.75
SMOOTHING = 0.1  # seconds, standard deviation of the filter on the path
AROUND = 0.6  # seconds before and after a passage in which the body may leave its path
ROUNDS = 40


def trunk_offset(motion: Array | Motion, partner: Motion, skeleton: Skeleton) -> Array:
    """``(T, 2)`` metres, x and z: from the middle of the partner's trunk to that of a body.

    Parameters
    ----------
    motion, partner : (T, J, 3) metres, y up
    skeleton : of both; one whose trunk has no pairs of joints by name has its root as the middle
    """
    joints = [joint for pair in trunk_pairs(skeleton) for joint in pair] or [skeleton.root]
    middle, other = (
        person[:, joints].astype(np.float64).mean(axis=1) for person in (motion, partner)
    )
    return np.asarray((middle - other)[:, [0, 2]])


def avoid_partner(
    motion: Array, partner: Motion, fps: float, skeleton: Skeleton, least: float
) -> Array:
    """Keep a body at a distance from the partner; a motion that keeps it is unchanged.

    Parameters
    ----------
    motion : (T, J, 3) metres, y up
    partner : (T, J, 3) metres
    fps : frames per second
    skeleton : of both
    least : metres, of ``trunk_offset``, of captured people

    Returns
    -------
    (T, J, 3) metres
    """
    offset = trunk_offset(motion, partner, skeleton)
    inside = np.linalg.norm(offset, axis=1) < INSIDE * least
    if not inside.any():
        return motion
    near = maximum_filter1d(inside.astype(np.float64), 2 * round(AROUND * fps) + 1)
    share = gaussian_filter1d(near, SMOOTHING * fps, mode="nearest")[:, None]
    radius = least * share
    path = _pushed_out(offset, radius)
    for _ in range(ROUNDS):
        smooth = gaussian_filter1d(path, SMOOTHING * fps, axis=0, mode="nearest")
        path = _pushed_out(path + share * (smooth - path), radius)
    moved = motion.copy()
    moved[..., [0, 2]] += (path - offset)[:, None]
    return moved


def _pushed_out(path: Array, radius: Array) -> Array:
    """Return a path ``(T, 2)`` outside of circles about the origin, of radii (T, 1), or on them."""
    distance = np.linalg.norm(path, axis=1, keepdims=True)
    return np.asarray(path * np.maximum(radius / np.maximum(distance, 1e-6), 1))
