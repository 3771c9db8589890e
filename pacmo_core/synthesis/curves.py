"""Smooth functions of time: how a limb or a body gets from one place to another."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def minimum_jerk(fraction: Array) -> Array:
    """Go from 0 to 1 with least jerk, at rest at both ends (Flash and Hogan 1985, eq. 3).

    Parameters
    ----------
    fraction : (...) float64, of the time of the movement; held at 0 before it and at 1 after it
    """
    x = np.clip(fraction, 0.0, 1.0)
    return x**3 * (10.0 + x * (6.0 * x - 15.0))


def ramp(times: Array, start: float, stop: float) -> Array:
    """Go from 0 at ``start`` to 1 at ``stop`` (seconds) with least jerk."""
    return minimum_jerk((times - start) / (stop - start))


def window(times: Array, start: float, arrive: float, leave: float, back: float) -> Array:
    """Go from 0 to 1 from ``start`` to ``arrive``, hold, and back from ``leave`` to ``back``."""
    return ramp(times, start, arrive) * (1.0 - ramp(times, leave, back))


def bump(fraction: Array) -> Array:
    """Rise from 0 to 1 at one half and fall again, with no jolt at either end."""
    x = np.clip(fraction, 0.0, 1.0)
    return (4.0 * x * (1.0 - x)) ** 3


def glide(times: Array, start: float, stop: float, ease: float) -> Array:
    """Travel from 0 to 1: speed up for ``ease`` seconds, keep the pace, slow down for as long.

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
    """Give a smooth lower bound of both, less than either by at most ``width`` ln 2."""
    return -width * np.logaddexp(-first / width, -np.asarray(second) / width)


def soft_max(first: Array, second: Array | float, width: float) -> Array:
    """Give a smooth upper bound of both, more than either by at most ``width`` ln 2."""
    return -soft_min(-first, -np.asarray(second), width)


def drift(times: Array, phases: Array, rates: Array) -> Array:
    """Wander slowly about 0 with variance 1: a sum of sinusoids.

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
    wander: Array = np.sin(angle).sum(axis=1) * np.sqrt(2.0 / phases.shape[1])
    return wander
