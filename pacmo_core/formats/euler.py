"""Rotations as three turns about a joint's own axes, in any order of the axes."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
LOCKED = 1e-6  # cosine of the middle angle below which the outer two turns are one


def rotation_of(axis: int, degrees: Array) -> Array:
    """``(T, 3, 3)``: turns about one axis, on column vectors."""
    angle = np.radians(degrees)
    cos, sin = np.cos(angle), np.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turns = np.tile(np.eye(3), (len(degrees), 1, 1))
    turns[:, i, i] = turns[:, j, j] = cos
    turns[:, i, j], turns[:, j, i] = -sin, sin
    return turns


def angles_of(rotations: Array, order: Sequence[int]) -> Array:
    """``(T, 3)`` degrees about three different axes in turn, without jumps, of (T, 3, 3).

    Parameters
    ----------
    order : the axes, 0 to 2, the first turn first
    """
    found: Array = np.degrees(np.unwrap(np.radians(_principal(rotations, order)), axis=0))
    return found


def angles_like(rotations: Array, order: Sequence[int], like: Array) -> Array:
    """``(T, 3)`` degrees: of all that give a rotation, those nearest to others.

    Parameters
    ----------
    like : (T, 3) degrees, such as a file's own before its motion changed
    """
    one = _principal(rotations, order)
    # Turning the outer two by half a turn and mirroring the middle one gives the same rotation.
    other = np.stack([one[:, 0] + 180, 180 - one[:, 1], one[:, 2] + 180], axis=-1)
    near = [angles + 360 * np.rint((like - angles) / 360) for angles in (one, other)]
    apart = [np.square(angles - like).sum(axis=1, keepdims=True) for angles in near]
    nearest: Array = np.where(apart[0] <= apart[1], near[0], near[1])
    return nearest


def _principal(rotations: Array, order: Sequence[int]) -> Array:
    """``(T, 3)`` degrees, the middle one within a right angle of none."""
    i, j, k = order
    even = 1.0 if (j - i) % 3 == 1 else -1.0
    r = rotations
    middle = even * np.arcsin((r[:, i, k]).clip(-1, 1))
    locked = np.hypot(r[:, j, k], r[:, k, k]) < LOCKED
    last = np.where(locked, 0.0, np.arctan2(-even * r[:, i, j], r[:, i, i]))
    free = np.arctan2(-even * r[:, j, k], r[:, k, k])
    first = np.where(locked, np.arctan2(even * r[:, k, j], r[:, j, j]), free)
    angles: Array = np.degrees(np.stack([first, middle, last], axis=-1))
    return angles
