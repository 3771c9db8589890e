"""Samples at any times as a function of time: interpolating and smoothing splines.

An interpolating spline of a noisy motion depends on which frames were captured; a smoothing spline
hardly does. The noise is estimated from the frames, so clean motion capture is unchanged.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline
from scipy.linalg import solveh_banded

# Power spectral density of human accelerations, m²/s³: about 5 m/s² up to about 3 Hz.
ACCELERATION_DENSITY = 4.0
MIN_FRAMES = 7  # with fewer, noise and motion cannot be separated, and nothing is smoothed

Array = NDArray[np.float64]


class Spline:
    """The cubic spline through samples of a function of time.

    Parameters
    ----------
    times : (T,), strictly increasing, T >= 2
    values : (T, ...), finite

    Notes
    -----
    Not-a-knot ends: cubics are reproduced exactly from four samples on, whatever their spacing.
    """

    def __init__(self, times: ArrayLike, values: ArrayLike) -> None:
        self.start, self.end = float(np.asarray(times)[0]), float(np.asarray(times)[-1])
        self._spline = CubicSpline(np.asarray(times, float), np.asarray(values, float), axis=0)

    def __call__(self, times: ArrayLike) -> NDArray[np.float64]:
        """Evaluate at times within the samples: ``(N, ...)``.

        Raises
        ------
        ValueError
            If a time lies outside the samples: a spline does not extrapolate motion.
        """
        checked = self.check(times)
        values: NDArray[np.float64] = self._spline(checked.clip(self.start, self.end))
        return values

    def check(self, times: ArrayLike) -> NDArray[np.float64]:
        """Return times as an array, or raise ``ValueError`` as a call does."""
        checked = np.asarray(times, dtype=np.float64)
        tolerance = 1e-9 * max(1.0, abs(self.end), self.end - self.start)
        if checked.min() < self.start - tolerance or checked.max() > self.end + tolerance:
            raise ValueError(
                f"times must be in [{self.start:g}, {self.end:g}] s; "
                f"got [{checked.min():g}, {checked.max():g}]"
            )
        return checked

    def on_grid(self, n_points: int) -> NDArray[np.float64]:
        """Evaluate on ``n_points`` evenly spaced times with both ends."""
        return self(np.linspace(self.start, self.end, n_points))


class SmoothingSpline(Spline):
    """A cubic smoothing spline of a motion, with weight by its estimated noise.

    With noise of variance s² and accelerations of white noise of density q, the maximum a
    posteriori motion is the cubic smoothing spline of weight s²/q with natural ends (Wahba 1978,
    *Improper priors, spline smoothing*).

    Parameters
    ----------
    times : (T,) seconds, strictly increasing
    motion : (T, J, 3), metres; of fewer than ``MIN_FRAMES`` it is interpolated
    """

    def __init__(self, times: Array, motion: NDArray[np.float32]) -> None:
        if len(times) < MIN_FRAMES:
            super().__init__(times, motion)
            return
        self.start, self.end = float(times[0]), float(times[-1])
        values = motion.reshape(len(motion), -1).astype(np.float64)
        weight = estimate_noise_variance(times, values) / ACCELERATION_DENSITY
        smooth = fit_smoothing_spline(times, values, weight).reshape(motion.shape)
        self._spline = CubicSpline(times, smooth, axis=0, bc_type="natural")


def estimate_noise_variance(times: Array, values: Array) -> float:
    """Estimate the variance of white noise in frames, a mean over channels.

    Each frame is predicted by the cubic through two neighbours on either side. For smooth motion
    the error is of fourth order in the step between frames; the residual is noise, of the frame and
    of the four neighbours.

    Parameters
    ----------
    times : (T,), T >= 5
    values : (T, C)
    """
    middle = np.arange(2, len(times) - 2)
    neighbours = middle[:, None] + np.array([-2, -1, 1, 2])
    weights = _lagrange_weights(times[neighbours], times[middle])
    residual = values[middle] - np.einsum("ij,ijc->ic", weights, values[neighbours])
    gain = 1 + (weights**2).sum(axis=1, keepdims=True)
    return float((residual**2 / gain).mean())


def fit_smoothing_spline(times: Array, values: Array, weight: float) -> Array:
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


def _lagrange_weights(near: Array, at: Array) -> Array:
    """Weigh four points ``(n, 4)`` so that cubics through them are met at ``(n,)``."""
    weights = np.ones_like(near)
    for j in range(4):
        for k in range(4):
            if k != j:
                weights[:, j] *= (at - near[:, k]) / (near[:, j] - near[:, k])
    return weights
