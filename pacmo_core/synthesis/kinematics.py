"""Rotations and limbs: the arithmetic of bones that keep their length.

A person's own frame is right-handed: x to the left, y up, z ahead.
"""

import numpy as np

from pacmo_core.synthesis.curves import Array, soft_max, soft_min

REACH = 0.997  # of a straight limb: no elbow or knee is ever fully extended
FOLD = 0.30  # of a straight limb: nor folded upon itself
SOFT = 0.002  # metres over which the two limits take hold


def turn(yaw: Array) -> Array:
    """Rotate about y: (T,) radians, positive to the left, as (T, 3, 3)."""
    c, s, zero, one = np.cos(yaw), np.sin(yaw), np.zeros_like(yaw), np.ones_like(yaw)
    return _matrices([[c, zero, s], [zero, one, zero], [-s, zero, c]])


def pitch(angle: Array) -> Array:
    """Rotate about x: (T,) radians, positive bows forward, as (T, 3, 3)."""
    c, s, zero, one = np.cos(angle), np.sin(angle), np.zeros_like(angle), np.ones_like(angle)
    return _matrices([[one, zero, zero], [zero, c, -s], [zero, s, c]])


def roll(angle: Array) -> Array:
    """Rotate about z: (T,) radians, positive tilts to the right, as (T, 3, 3)."""
    c, s, zero, one = np.cos(angle), np.sin(angle), np.zeros_like(angle), np.ones_like(angle)
    return _matrices([[c, -s, zero], [s, c, zero], [zero, zero, one]])


def _matrices(rows: list[list[Array]]) -> Array:
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def unit(vectors: Array) -> Array:
    """Scale (..., 3) to length 1."""
    scaled: Array = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return scaled


def two_bones(
    root: Array, goal: Array, lengths: tuple[float, float], pole: Array
) -> tuple[Array, Array]:
    """Bend a limb of two bones so that its end comes to ``goal``, the joint toward ``pole``.

    By the law of cosines; a goal too far or too near is met on the line to it as nearly as
    ``REACH`` and ``FOLD`` allow.

    Parameters
    ----------
    root, goal : (T, 3) metres
    lengths : of the upper and the lower bone, metres; one at most 1.8 times the other
    pole : (T, 3) direction to which the middle joint points; not along the limb

    Returns
    -------
    (T, 3) middle joint, (T, 3) end, metres
    """
    upper, lower = lengths
    along = goal - root
    wanted = np.linalg.norm(along, axis=-1)
    distance = soft_max(wanted, FOLD * (upper + lower), SOFT)
    distance = soft_min(distance, REACH * (upper + lower), SOFT)
    along = along / wanted[:, None]
    side = unit(pole - (pole * along).sum(axis=-1, keepdims=True) * along)
    foot = (upper**2 - lower**2 + distance**2) / (2.0 * distance)
    height = np.sqrt(upper**2 - foot**2)
    middle = root + foot[:, None] * along + height[:, None] * side
    return middle, root + distance[:, None] * along
