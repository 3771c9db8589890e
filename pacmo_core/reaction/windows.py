"""Partners longer than the training clips, as overlapping windows of the mean training duration.

Time is normalised over a window, so a model is valid only for durations it was trained on. A longer
sequence is cut into windows half a window apart, whose outputs are cross-faded. All windows share
one realisation of the noise, a random field of absolute time. A ``WindowQuery`` holds what a model
needs to react in one window: the partner's motion, its frame and the noise.
"""

import math
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pacmo_core.data.interaction import Motion
from pacmo_core.data.transforms import Frame, body_frame
from pacmo_core.operators.random_field import GaussianRandomField
from pacmo_core.operators.spline import SmoothingSpline, Spline
from pacmo_core.reaction.baselines import Gru
from pacmo_core.reaction.generator import Generator
from pacmo_core.reaction.inputs import Normalisation, action_indices

# Standard deviations of log-duration above the mean up to which a sequence is taken whole.
MAX_DURATION_STDS = 3.0
# Windows after which the noise has forgotten what it was: long beside the overlap of half a one.
NOISE_CORRELATION = 2.0
# Share of the clock by which an instant may miss a window's end by rounding.
TIME_TOLERANCE = 1e-9

# The instants that a window covers, and its weight at each.
WindowWeights = tuple[slice, NDArray[np.float64]]


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


def mean_duration(normalisation: Normalisation) -> float:
    """Seconds that a model's training clips lasted: their geometric mean."""
    return math.exp(float(normalisation.log_duration[0]))


def max_duration(normalisation: Normalisation) -> float:
    """Seconds up to which a model may be trusted with a sequence whole."""
    mean, spread = normalisation.log_duration.tolist()
    return math.exp(mean + MAX_DURATION_STDS * spread)


def split_into_windows(start: float, end: float, normalisation: Normalisation) -> list[Window]:
    """Take a sequence whole if it is no longer than usual; else cut it, evenly spaced."""
    duration = end - start
    if duration <= max_duration(normalisation):
        return [Window(start, duration)]
    usual = mean_duration(normalisation)
    count = math.ceil(2 * (duration - usual) / usual) + 1
    return [Window(float(first), usual) for first in np.linspace(start, end - usual, count)]


def window_weights(windows: list[Window], times: NDArray[np.float64]) -> list[WindowWeights]:
    """Weigh each window at the instants it covers; at every instant the weights add up to one.

    A window counts most in its middle and not at all at its ends, except where no other covers
    the sequence.

    Parameters
    ----------
    times : (T,) ascending, seconds
    """
    found, total = [], np.zeros(len(times))
    for i, window in enumerate(windows):
        slack = TIME_TOLERANCE * max(1.0, abs(window.end))
        first, last = np.searchsorted(times, [window.start - slack, window.end + slack])
        x = window.inside(times[first:last])
        weights = _hann_weights(x, first=i == 0, last=i == len(windows) - 1)
        total[first:last] += weights
        found.append((slice(int(first), int(last)), weights))
    return [(rows, weights / total[rows]) for rows, weights in found]


class ContinuousNoise:
    """One random field over all time, handed out window by window.

    Between independent draws, ``MEMORY`` windows apart, coefficients go round a quarter circle,
    which keeps their law: every window sees exactly the noise that the model was trained with, and
    windows that overlap see nearly the same function.

    Parameters
    ----------
    field : the law
    draw : gives fresh coefficients, of any shape ``(..., 2 K)``
    """

    def __init__(self, field: GaussianRandomField, draw: Callable[[], Tensor]) -> None:
        self._field, self._draw = field, draw
        self._knots = deque[Tensor](maxlen=2)
        self._drawn = 0

    def at(self, start: float) -> Tensor:
        """Give the coefficients of a window.

        Parameters
        ----------
        start : of the window, in windows since the beginning; not before the last one asked for
        """
        number, share = divmod(start / NOISE_CORRELATION, 1)
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


def _hann_weights(x: NDArray[np.float64], *, first: bool, last: bool) -> NDArray[np.float64]:
    """Rise to one in the middle of a window and fall; not where it is the first or the last."""
    bell: NDArray[np.float64] = np.sin(np.pi * x.clip(1e-6, 1 - 1e-6)) ** 2
    if first:
        bell[x < 0.5] = 1
    if last:
        bell[x >= 0.5] = 1
    return bell


ReactionModel = Generator | Gru


@dataclass(frozen=True)
class PartnerMotion:
    """A motion to react to, and when the reaction is wanted.

    Parameters
    ----------
    motion : (T, J, 3) float32, metres, in the world
    times : (T,) float64, seconds, strictly increasing
    out_times : (T_out,) float64, seconds, ascending, within ``times``
    action : the interaction's label, for a model that was trained on labels; else empty
    """

    motion: Motion
    times: NDArray[np.float64]
    out_times: NDArray[np.float64]
    action: str = ""


@dataclass(frozen=True)
class WindowQuery:
    """One window of a partner's motion, and what of the reaction it answers for.

    Parameters
    ----------
    owner : which partner
    motion : spline of the partner in the world
    window : Window
    frame : of the partner at the window's start
    noise : (S, k, 2 K) coefficients; none for the baseline
    action : number of the label; 0 where labels are no condition
    rows : of the reaction
    instants : (rows,) float64, seconds
    weights : (rows,) float64, the window's share at each
    """

    owner: int
    motion: Spline
    window: Window
    frame: Frame
    noise: Tensor
    action: int
    rows: slice
    instants: NDArray[np.float64]
    weights: NDArray[np.float64]

    def local(self, instants: NDArray[np.float64]) -> NDArray[np.float32]:
        """``(N, 3 J)``: the partner at instants, seen from the frame."""
        return self.frame.to_local(sample_poses(self.motion, instants)).reshape(len(instants), -1)


def window_queries(
    model: ReactionModel, partners: Sequence[PartnerMotion], n_samples: int, random: torch.Generator
) -> Iterator[WindowQuery]:
    """Cut every partner into windows, when their turn comes."""
    for owner, partner in enumerate(partners):
        motion = SmoothingSpline(partner.times, partner.motion)
        motion.check(partner.out_times)
        windows = split_into_windows(motion.start, motion.end, model.normalisation)
        noise = continuous_noise(model, n_samples, random)
        action = action_index(model, partner.action)
        for window, (rows, weights) in zip(
            windows, window_weights(windows, partner.out_times), strict=True
        ):
            if not len(weights):
                continue  # nobody asks for what this window could answer
            shift = (window.start - motion.start) / window.duration
            yield WindowQuery(
                owner=owner,
                motion=motion,
                window=window,
                frame=body_frame(sample_poses(motion, np.array([window.start])), model.skeleton),
                noise=noise.at(shift) if noise else torch.zeros(0),
                action=action,
                rows=rows,
                instants=partner.out_times[rows],
                weights=weights,
            )


def continuous_noise(
    model: ReactionModel, n_samples: int, random: torch.Generator
) -> ContinuousNoise | None:
    """Make the noise of so many reactions to one partner; the baseline takes none."""
    if n_samples < 1 or (is_deterministic(model) and n_samples != 1):
        wanted = "1: the model is deterministic" if is_deterministic(model) else "1 or more"
        raise ValueError(f"n_samples must be {wanted}; got {n_samples}")
    if isinstance(model, Gru):
        return None
    return ContinuousNoise(model.config.noise, lambda: model.draw(n_samples, random))


def is_deterministic(model: ReactionModel) -> bool:
    """Say whether a model has one reaction to a partner and no noise."""
    return isinstance(model, Gru) or not model.config.noise_channels


def action_index(model: ReactionModel, action: str) -> int:
    """Look up a label; a model without labels takes none."""
    known = () if isinstance(model, Gru) else model.config.actions
    if not known and not action:
        return 0
    return int(action_indices([action], known))


def sample_poses(motion: Spline, instants: NDArray[np.float64]) -> Motion:
    """``(N, J, 3)`` float32: a motion at instants."""
    found: Motion = motion(instants).astype(np.float32)
    return found
