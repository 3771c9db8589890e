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
    i, j, k = order
    even = 1.0 if (j - i) % 3 == 1 else -1.0
    r = rotations
    middle = even * np.arcsin((r[:, i, k]).clip(-1, 1))
    locked = np.hypot(r[:, j, k], r[:, k, k]) < LOCKED
    last = np.where(locked, 0.0, np.arctan2(-even * r[:, i, j], r[:, i, i]))
    free = np.arctan2(-even * r[:, j, k], r[:, k, k])
    first = np.where(locked, np.arctan2(even * r[:, k, j], r[:, j, j]), free)
    turns = np.stack([first, middle, last], axis=-1)
    found: Array = np.degrees(np.unwrap(turns, axis=0))
    return found
