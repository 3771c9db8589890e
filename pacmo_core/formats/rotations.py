"""Rotations over time: about one axis, as Euler angles in any order, applied to vectors.

``Frames`` are ``(3, 3, T)``: column, row, frame. Columns come first because a rotation about one
axis mixes the other two columns and leaves the rest unchanged.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Frames = NDArray[np.float64]


def identity_frames(count: int) -> Frames:
    """Make ``count`` identity frames."""
    return np.repeat(np.eye(3)[:, :, None], count, axis=2)


def rotate_about_axis(frames: Frames, axis: int, degrees: NDArray[np.float64]) -> Frames:
    """Rotate about an axis of the frame itself: ``frames @ R(axis, degrees)`` on column vectors.

    Parameters
    ----------
    frames : (3, 3, T) column, row, frame
    axis : 0, 1 or 2
    degrees : (T,) counter-clockwise as seen from the axis' tip
    """
    angle = np.radians(degrees)
    cos, sin = np.cos(angle), np.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    rotated = frames.copy()
    rotated[i] = cos * frames[i] + sin * frames[j]
    rotated[j] = cos * frames[j] - sin * frames[i]
    return rotated


def to_world(frames: Frames, vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Transform vectors from the frames to the world: ``(T, 3)`` from ``(3,)`` or ``(T, 3)``."""
    broadcast = np.broadcast_to(vectors, (frames.shape[2], 3))
    world: NDArray[np.float64] = np.einsum("crt,tc->tr", frames, broadcast)
    return world


Array = NDArray[np.float64]
GIMBAL_LOCK = 1e-6  # cosine of the middle angle below which the outer two axes coincide


def axis_rotations(axis: int, degrees: Array) -> Array:
    """``(T, 3, 3)``: rotations about a coordinate axis, on column vectors."""
    angle = np.radians(degrees)
    cos, sin = np.cos(angle), np.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    rotations = np.tile(np.eye(3), (len(degrees), 1, 1))
    rotations[:, i, i] = rotations[:, j, j] = cos
    rotations[:, i, j], rotations[:, j, i] = -sin, sin
    return rotations


def euler_angles_near(rotations: Array, order: Sequence[int], reference: Array) -> Array:
    """``(T, 3)`` degrees: of the Euler angles that give a rotation, those nearest to ``reference``.

    Parameters
    ----------
    reference : (T, 3) degrees, such as those of the file before its motion changed
    """
    return _nearest_angles(_both_angles(rotations, order), reference)


def continuous_euler_angles(rotations: Array, order: Sequence[int], reference: Array) -> Array:
    """``(T, 3)`` degrees: Euler angles of a motion, each nearest to those of the frame before.

    Parameters
    ----------
    reference : (T, 3) degrees, of which the first are those before the first frame
    """
    both = _both_angles(rotations, order)
    angles, before = np.zeros_like(reference), reference[:1]
    for frame in range(len(angles)):
        before = _nearest_angles(both[frame : frame + 1], before)
        angles[frame] = before[0]
    return angles


def _nearest_angles(both: Array, reference: Array) -> Array:
    """``(T, 3)``: of the two triples of each frame (T, 2, 3), and their full turns, the nearest."""
    candidates = both + 360 * np.rint((reference[:, None] - both) / 360)
    distance = np.square(candidates - reference[:, None]).sum(axis=-1)
    nearest: Array = candidates[np.arange(len(both)), distance.argmin(axis=1)]
    return nearest


def _both_angles(rotations: Array, order: Sequence[int]) -> Array:
    """``(T, 2, 3)`` degrees: the two triples of Euler angles that give each rotation."""
    principal = _principal_angles(rotations, order)
    # 180 degrees more in the outer two and a mirrored middle angle give the same rotation.
    alternative = np.stack(
        [principal[:, 0] + 180, 180 - principal[:, 1], principal[:, 2] + 180], axis=-1
    )
    return np.stack([principal, alternative], axis=1)


def _principal_angles(rotations: Array, order: Sequence[int]) -> Array:
    """``(T, 3)`` degrees, the middle angle between -90 and 90."""
    i, j, k = order
    even = 1.0 if (j - i) % 3 == 1 else -1.0
    r = rotations
    middle = even * np.arcsin((r[:, i, k]).clip(-1, 1))
    locked = np.hypot(r[:, j, k], r[:, k, k]) < GIMBAL_LOCK
    last = np.where(locked, 0.0, np.arctan2(-even * r[:, i, j], r[:, i, i]))
    free = np.arctan2(-even * r[:, j, k], r[:, k, k])
    first = np.where(locked, np.arctan2(even * r[:, k, j], r[:, j, j]), free)
    angles: Array = np.degrees(np.stack([first, middle, last], axis=-1))
    return angles
