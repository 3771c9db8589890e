"""Sequences longer than a model has seen in training, as overlapping windows of usual length.

Time is normalised over a window, so a model knows only the durations it was trained on. A longer
sequence is cut into windows half a window apart, and what they say of an instant is cross-faded.
They speak of one reaction as far as the noise goes: it is one field of absolute time.
"""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from pacmo_core.operators.random_field import RandomField
from pacmo_core.reaction.normalisation import Normalisation

# Standard deviations of log-duration above the mean up to which a sequence is taken whole.
WIDEST = 3.0
# Windows after which the noise has forgotten what it was: long beside the overlap of half a one.
MEMORY = 2.0
# Share of the clock by which an instant may miss a window's end by rounding.
SLACK = 1e-9

# The instants that a window covers, and its weight at each.
Share = tuple[slice, NDArray[np.float64]]


@dataclass(frozen=True)
class Window:
    """A stretch of time.

    Parameters
    ----------
    start, duration : seconds
    """

    start: float
    duration: float

    @property
    def end(self) -> float:
        """Seconds."""
        return self.start + self.duration

    def inside(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Give instants as shares of the window: 0 at its start, 1 at its end."""
        return (times - self.start) / self.duration


def usual_duration(normalisation: Normalisation) -> float:
    """Seconds that a model's training clips lasted: their geometric mean."""
    return math.exp(float(normalisation.log_duration[0]))


def longest_duration(normalisation: Normalisation) -> float:
    """Seconds up to which a model may be trusted with a sequence whole."""
    mean, spread = normalisation.log_duration.tolist()
    return math.exp(mean + WIDEST * spread)


def cut(start: float, end: float, normalisation: Normalisation) -> list[Window]:
    """Take a sequence whole if it is no longer than usual; else cut it, evenly spaced."""
    duration = end - start
    if duration <= longest_duration(normalisation):
        return [Window(start, duration)]
    usual = usual_duration(normalisation)
    count = math.ceil(2 * (duration - usual) / usual) + 1
    return [Window(float(first), usual) for first in np.linspace(start, end - usual, count)]


def shares(windows: list[Window], times: NDArray[np.float64]) -> list[Share]:
    """Weigh each window at the instants it covers; at every instant the weights add up to one.

    A window counts most in its middle and not at all at its ends, except where no other covers
    the sequence.

    Parameters
    ----------
    times : (T,) ascending, seconds
    """
    found, total = [], np.zeros(len(times))
    for i, window in enumerate(windows):
        slack = SLACK * max(1.0, abs(window.end))
        first, last = np.searchsorted(times, [window.start - slack, window.end + slack])
        x = window.inside(times[first:last])
        weights = _bell(x, first=i == 0, last=i == len(windows) - 1)
        total[first:last] += weights
        found.append((slice(int(first), int(last)), weights))
    return [(rows, weights / total[rows]) for rows, weights in found]


class EndlessNoise:
    """One random field over all time, handed out window by window.

    Between independent draws, ``MEMORY`` windows apart, coefficients go round a quarter circle,
    which keeps their law: every window sees exactly the noise that the model was trained with, and
    windows that overlap see nearly the same function.

    Parameters
    ----------
    field : the law
    draw : gives fresh coefficients, of any shape ``(..., 2 K)``
    """

    def __init__(self, field: RandomField, draw: Callable[[], Tensor]) -> None:
        self._field, self._draw = field, draw
        self._knots = deque[Tensor](maxlen=2)
        self._drawn = 0

    def at(self, start: float) -> Tensor:
        """Give the coefficients of a window.

        Parameters
        ----------
        start : of the window, in windows since the beginning; not before the last one asked for
        """
        number, share = divmod(start / MEMORY, 1)
        coefficients = self._knot(int(number))
        if share:
            angle = math.pi / 2 * share * share * (3 - 2 * share)
            later = self._knot(int(number) + 1)
            coefficients = math.cos(angle) * coefficients + math.sin(angle) * later
        return self._field.shifted(coefficients, start) if start else coefficients

    def _knot(self, number: int) -> Tensor:
        while self._drawn <= number:
            self._knots.append(self._draw())
            self._drawn += 1
        return self._knots[number - self._drawn]


def _bell(x: NDArray[np.float64], *, first: bool, last: bool) -> NDArray[np.float64]:
    """Rise to one in the middle of a window and fall; not where it is the first or the last."""
    bell: NDArray[np.float64] = np.sin(np.pi * x.clip(1e-6, 1 - 1e-6)) ** 2
    if first:
        bell[x < 0.5] = 1
    if last:
        bell[x >= 0.5] = 1
    return bell
