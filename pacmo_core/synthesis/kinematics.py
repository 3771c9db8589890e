"""Smooth functions of time, rotations and two-bone inverse kinematics.

A person's own frame is right-handed: x to the left, y up, z ahead.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def minimum_jerk(fraction: Array) -> Array:
    """Return the minimum-jerk transition from 0 to 1 (Flash and Hogan 1985, eq. 3).

    Parameters
    ----------
    fraction : (...) float64, of the time of the movement; held at 0 before it and at 1 after it
    """
    x = np.clip(fraction, 0.0, 1.0)
    return x**3 * (10.0 + x * (6.0 * x - 15.0))


def ramp(times: Array, start: float, stop: float) -> Array:
    """Return the minimum-jerk transition from 0 at ``start`` to 1 at ``stop`` (seconds)."""
    return minimum_jerk((times - start) / (stop - start))


def window(times: Array, start: float, arrive: float, leave: float, back: float) -> Array:
    """Return a weight that rises from ``start`` to ``arrive``, and falls after ``leave``."""
    return ramp(times, start, arrive) * (1.0 - ramp(times, leave, back))


def bump(fraction: Array) -> Array:
    """Return a smooth rise from 0 to 1 at one half and back to 0."""
    x = np.clip(fraction, 0.0, 1.0)
    return (4.0 * x * (1.0 - x)) ** 3


def ease_in_out(times: Array, start: float, stop: float, ease: float) -> Array:
    """Return a transition from 0 to 1 with ``ease`` seconds of acceleration and of deceleration.

    The speed is a minimum-jerk rise and fall, so acceleration is continuous.
    """
    ease = min(ease, 0.5 * (stop - start))
    rise = _integral((times - start) / ease)
    fall = _integral((times - stop + ease) / ease)
    return ease * (rise - fall) / (stop - start - ease)


def _integral(x: Array) -> Array:
    """Integrate ``minimum_jerk`` from 0 to x."""
    inside = np.clip(x, 0.0, 1.0)
    return inside**4 * (2.5 + inside * (inside - 3.0)) + np.maximum(x - 1.0, 0.0)


def soft_min(first: Array, second: Array | float, width: float) -> Array:
    """Return a smooth minimum, below the minimum by at most ``width`` ln 2."""
    return -width * np.logaddexp(-first / width, -np.asarray(second) / width)


def soft_max(first: Array, second: Array | float, width: float) -> Array:
    """Return a smooth maximum, above the maximum by at most ``width`` ln 2."""
    return -soft_min(-first, -np.asarray(second), width)


def sum_of_sines(times: Array, phases: Array, rates: Array) -> Array:
    """Return a sum of sinusoids with mean 0 and variance 1.

    Parameters
    ----------
    times : (T,) seconds
    phases : (C, N) radians
    rates : (C, N) hertz

    Returns
    -------
    (C, T)
    """
    angle = 2.0 * np.pi * rates[:, :, None] * times + phases[:, :, None]
    total: Array = np.sin(angle).sum(axis=1) * np.sqrt(2.0 / phases.shape[1])
    return total


MAX_EXTENSION = 0.997  # of a straight limb: no elbow is fully extended
MIN_EXTENSION = 0.30  # of a straight limb: no limb is fully folded
LIMIT_WIDTH = 0.002  # metres over which the limits are smoothed


def rotation_y(yaw: Array) -> Array:
    """Return rotations about y, (T, 3, 3), from (T,) radians, positive to the left."""
    c, s, zero, one = np.cos(yaw), np.sin(yaw), np.zeros_like(yaw), np.ones_like(yaw)
    return _matrices([[c, zero, s], [zero, one, zero], [-s, zero, c]])


def rotation_x(angle: Array) -> Array:
    """Return rotations about x, (T, 3, 3), from (T,) radians, positive forward."""
    c, s, zero, one = np.cos(angle), np.sin(angle), np.zeros_like(angle), np.ones_like(angle)
    return _matrices([[one, zero, zero], [zero, c, -s], [zero, s, c]])


def rotation_z(angle: Array) -> Array:
    """Return rotations about z, (T, 3, 3), from (T,) radians, positive to the right."""
    c, s, zero, one = np.cos(angle), np.sin(angle), np.zeros_like(angle), np.ones_like(angle)
    return _matrices([[c, -s, zero], [s, c, zero], [zero, zero, one]])


def _matrices(rows: list[list[Array]]) -> Array:
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def normalise(vectors: Array) -> Array:
    """Scale (..., 3) to length 1."""
    scaled: Array = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return scaled


def two_bone_ik(
    root: Array,
    goal: Array,
    lengths: tuple[float, float],
    pole: Array,
    max_extension: float = MAX_EXTENSION,
) -> tuple[Array, Array]:
    """Two-bone inverse kinematics: the end reaches ``goal``, the middle joint points to ``pole``.

    By the law of cosines. A goal that is too far or too near is replaced by the nearest point on
    the line to it within ``MIN_EXTENSION`` and ``max_extension``.

    Parameters
    ----------
    root, goal : (T, 3) metres
    lengths : of the upper and the lower bone, metres; their ratio is at most 1.8
    pole : (T, 3) direction of the middle joint; not along the limb
    max_extension : of the limb, at most, over its length

    Returns
    -------
    (T, 3) middle joint, (T, 3) end, metres
    """
    upper, lower = lengths
    along = goal - root
    target = np.linalg.norm(along, axis=-1)
    distance = soft_max(target, MIN_EXTENSION * (upper + lower), LIMIT_WIDTH)
    distance = soft_min(distance, max_extension * (upper + lower), LIMIT_WIDTH)
    along = along / target[:, None]
    side = normalise(pole - (pole * along).sum(axis=-1, keepdims=True) * along)
    foot = (upper**2 - lower**2 + distance**2) / (2.0 * distance)
    height = np.sqrt(upper**2 - foot**2)
    middle = root + foot[:, None] * along + height[:, None] * side
    return middle, root + distance[:, None] * along
