"""A capture's frames less their noise, as far as the frames themselves tell the two apart.

A reaction should answer how a partner moved, not which frames happened to show it. A spline through
noisy frames is another function for every choice of frames; a smoothing spline is nearly one. How
much to smooth is not chosen but estimated: clean motion capture is left as it is.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.linalg import solveh_banded

from pacmo_core.data.interaction import Motion
from pacmo_core.operators.encode import Spline

# Power of people's accelerations per hertz, m²/s³: some 5 m/s² up to some 3 Hz.
ACCELERATION_DENSITY = 4.0
LEAST_FRAMES = 7  # with fewer, noise can't be told from motion, and nothing is done

Array = NDArray[np.float64]


class Denoised(Spline):
    """A motion smoothed as much as its own noise calls for.

    With noise of variance s² and accelerations that are white of density q, the likeliest motion
    given the frames is the cubic smoothing spline of weight s²/q, straight at its ends (Wahba 1978,
    *Improper priors, spline smoothing*).

    Parameters
    ----------
    times : (T,) seconds, strictly increasing
    motion : (T, J, 3), metres; of fewer than ``LEAST_FRAMES`` the spline through them
    """

    def __init__(self, times: Array, motion: Motion) -> None:
        if len(times) < LEAST_FRAMES:
            super().__init__(times, motion)
            return
        self.start, self.end = float(times[0]), float(times[-1])
        values = motion.reshape(len(motion), -1).astype(np.float64)
        weight = noise_variance(times, values) / ACCELERATION_DENSITY
        smooth = smoothed(times, values, weight).reshape(motion.shape)
        self._spline = CubicSpline(times, smooth, axis=0, bc_type="natural")


def noise_variance(times: Array, values: Array) -> float:
    """Estimate the variance of white noise in frames, a mean over channels.

    Each frame is foretold by the cubic through two neighbours on either side. Smooth motion is
    foretold to a fourth power of the step between frames; what is left over is noise, of the frame
    and of the four neighbours.

    Parameters
    ----------
    times : (T,), T >= 5
    values : (T, C)
    """
    middle = np.arange(2, len(times) - 2)
    near = middle[:, None] + np.array([-2, -1, 1, 2])
    shares = _lagrange(times[near], times[middle])
    left_over = values[middle] - np.einsum("ij,ijc->ic", shares, values[near])
    gain = 1 + (shares**2).sum(axis=1, keepdims=True)
    return float((left_over**2 / gain).mean())


def smoothed(times: Array, values: Array, weight: float) -> Array:
    """Take at its knots the g that minimises ``sum (y - g)^2 + weight * integral g''^2``.

    Reinsch's banded system (Green and Silverman 1994, section 2.3.3): for second derivatives c,
    ``(R + weight Q' Q) c = Q' y`` and ``g = y - weight Q c``.

    Parameters
    ----------
    times : (T,), T >= 4
    values : (T, C)
    weight : at least 0, in seconds cubed

    Returns
    -------
    (T, C)
    """
    step = np.diff(times)
    slope = 1 / step
    bend = np.diff(np.diff(values, axis=0) * slope[:, None], axis=0)  # Q' y
    both = slope[:-1] + slope[1:]
    bands = np.zeros((3, len(times) - 2))  # upper form: second, first, main diagonal
    bands[2] = (step[:-1] + step[1:]) / 3 + weight * (slope[:-1] ** 2 + both**2 + slope[1:] ** 2)
    bands[1, 1:] = step[1:-1] / 6 - weight * slope[1:-1] * (both[:-1] + both[1:])
    bands[0, 2:] = weight * slope[1:-2] * slope[2:-1]
    curvature = np.zeros((len(times), values.shape[1]))
    curvature[1:-1] = solveh_banded(bands, bend)
    # Q c: the second differences of c, which is zero beyond the ends.
    rises = np.diff(curvature, axis=0) * slope[:, None]
    bent = np.zeros_like(values)
    bent[:-1] += rises
    bent[1:] -= rises
    return values - weight * bent


def _lagrange(near: Array, at: Array) -> Array:
    """Weigh four points ``(n, 4)`` so that cubics through them are met at ``(n,)``."""
    shares = np.ones_like(near)
    for j in range(4):
        for k in range(4):
            if k != j:
                shares[:, j] *= (at - near[:, k]) / (near[:, j] - near[:, k])
    return shares
