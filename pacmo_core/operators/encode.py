"""Samples at any instants as a function that may be evaluated anywhere between them."""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline


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
