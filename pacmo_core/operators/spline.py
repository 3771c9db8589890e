"""Samples at any instants as a function of time: interpolating and smoothing splines.

A spline through noisy frames is another function for every choice of frames; a smoothing spline is
nearly one. How much to smooth is estimated from the frames, so clean motion capture is unchanged.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline
from scipy.linalg import solveh_banded


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

    def __call__(self, at: ArrayLike) -> NDArray[np.float64]:
        """Evaluate at instants within the samples: ``(N, ...)``.

        Raises
        ------
        ValueError
            If an instant lies outside the samples: a spline does not extrapolate motion.
        """
        instants = self.check(at)
        values: NDArray[np.float64] = self._spline(instants.clip(self.start, self.end))
        return values

    def check(self, at: ArrayLike) -> NDArray[np.float64]:
        """Give instants back as an array, or raise as a call does."""
        instants = np.asarray(at, dtype=np.float64)
        slack = 1e-9 * max(1.0, abs(self.end), self.end - self.start)
        if instants.min() < self.start - slack or instants.max() > self.end + slack:
            raise ValueError(
                f"instants must lie in [{self.start:g}, {self.end:g}] s; "
                f"got [{instants.min():g}, {instants.max():g}]"
            )
        return instants

    def on_grid(self, n_points: int) -> NDArray[np.float64]:
        """Evaluate on ``n_points`` evenly spaced instants, both ends among them."""
        return self(np.linspace(self.start, self.end, n_points))


# Power of people's accelerations per hertz, m²/s³: some 5 m/s² up to some 3 Hz.
ACCELERATION_DENSITY = 4.0
MIN_FRAMES = 7  # with fewer, noise can't be told from motion, and nothing is done

Array = NDArray[np.float64]


class SmoothingSpline(Spline):
    """A motion smoothed as much as its own noise calls for.

    With noise of variance s² and accelerations that are white of density q, the likeliest motion
    given the frames is the cubic smoothing spline of weight s²/q, straight at its ends (Wahba 1978,
    *Improper priors, spline smoothing*).

    Parameters
    ----------
    times : (T,) seconds, strictly increasing
    motion : (T, J, 3), metres; of fewer than ``LEAST_FRAMES`` the spline through them
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
    shares = _lagrange_weights(times[near], times[middle])
    left_over = values[middle] - np.einsum("ij,ijc->ic", shares, values[near])
    gain = 1 + (shares**2).sum(axis=1, keepdims=True)
    return float((left_over**2 / gain).mean())


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
    shares = np.ones_like(near)
    for j in range(4):
        for k in range(4):
            if k != j:
                shares[:, j] *= (at - near[:, k]) / (near[:, j] - near[:, k])
    return shares
