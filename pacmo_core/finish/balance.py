"""Balance: a body is over its feet.

A generated body drifts while its feet, which slide along slowly, are held: it ends ahead of them or
beside them, and would fall. So it does where feet take steps of their own in place of a glide.
People have the pelvis near the line between their feet, who stand nearer than who walk. The body
above the feet moves back to it, as far as captured bodies are from it.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from pacmo_core.data.segments import feet
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.finish.bones import leg_joints, leg_length
from pacmo_core.finish.stance import Mask

Array = NDArray[np.float64]

# Distance of the pelvis from the line between the ankles, by the legs' length, that captured people
# seldom exceed: 95 % of the frames of the default in which both feet stand, and of the others.
MAX_LEAN, MAX_LEAN_WALKING = 0.07, 0.09
SMOOTHING = 0.2  # seconds, standard deviation of the filter on the way back
N_PASSES = 2  # the filter takes a part of a short lean back: the second pass most of the rest


def keep_over_feet(
    motion: Array, placed: Array, stands: Mask, lengths: Array, fps: float, skeleton: Skeleton
) -> Array:
    """Move a body above its feet to where they carry it; a body of no two feet is unchanged.

    Parameters
    ----------
    motion : (T, J, 3) metres, y up
    placed : (T, J, 3) metres, the same with feet where they will stand
    stands : (F, T) in which frames each of ``segments.feet`` stands
    lengths : (E,) metres, of the bones
    fps : frames per second
    skeleton : of the motion

    Returns
    -------
    (T, J, 3) metres, of which knees and feet are as they were
    """
    if len(feet(skeleton)) != 2:
        return motion
    shares = np.where(stands.all(axis=0), MAX_LEAN, MAX_LEAN_WALKING)
    most = shares * leg_length(lengths, skeleton)
    first, second = (placed[:, foot[0]] * [1, 0, 1] for foot in feet(skeleton))
    root, way = motion[:, skeleton.root] * [1, 0, 1], np.zeros((len(motion), 3))
    for _ in range(N_PASSES):
        lean = _from_line(root - way, first, second)
        distance = np.maximum(np.linalg.norm(lean, axis=1), 1e-9)
        back = np.maximum(1 - most / distance, 0)[:, None] * lean
        way += gaussian_filter1d(back, SMOOTHING * fps, axis=0, mode="nearest")
    moved = motion - way[:, None]
    legs = leg_joints(skeleton)
    moved[:, legs] = motion[:, legs]
    return np.asarray(moved)


def _from_line(points: Array, first: Array, second: Array) -> Array:
    """``(T, 3)``: from the nearest point between two ends to each point."""
    offset, line = points - first, second - first
    along = (offset * line).sum(axis=1) / np.maximum((line**2).sum(axis=1), 1e-9)
    away: Array = offset - along.clip(0, 1)[:, None] * line
    return away
