"""Partners longer than the training clips, as overlapping windows of the mean training duration.

Time is normalised over a window, so a model is valid only for durations it was trained on. A longer
sequence is divided into windows that overlap by half, whose outputs are cross-faded. All windows
share one realisation of the noise, a random field of absolute time. A ``WindowQuery`` holds what a
model needs to react in one window: the partner's motion, its frame and the noise.
"""

import math
import sys
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
from pacmo_core.reaction.inputs import UNLABELLED, Normalisation, action_indices

# A sequence is one window up to so many standard deviations of log-duration above the mean.
MAX_DURATION_STDS = 3.0
MAX_TEMPERATURE = 2.0  # beyond it reactions are of no motion that was trained on
# Windows between independent samples of the noise: long compared with the overlap of half a window.
NOISE_INTERVAL = 2.0
MAX_WINDOWS = 20_000  # of a partner's motion: half a working day of clips of two seconds
# Relative rounding error of times at the ends of windows.
TIME_TOLERANCE = 1e-9

ReactionModel = Generator | Gru
# Slice of the times that a window covers, and its weight at each.
WindowWeights = tuple[slice, NDArray[np.float64]]
MAX_SEED = 2**62  # of the generator of a sample


@dataclass(frozen=True)
class Window:
    """An interval of time.

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

    def normalise(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Map times to normalised time: 0 at the window's start, 1 at its end."""
        return (times - self.start) / self.duration


@dataclass(frozen=True)
class PartnerMotion:
    """A motion to react to, and the times of the reaction.

    Parameters
    ----------
    motion : (T, J, 3) float32, metres, in the world
    times : (T,) float64, seconds, strictly increasing
    out_times : (T_out,) float64, seconds, ascending, within ``times``
    action : label of the interaction, for a model that is conditioned on labels; else empty
    """

    motion: Motion
    times: NDArray[np.float64]
    out_times: NDArray[np.float64]
    action: str = ""


@dataclass(frozen=True)
class WindowQuery:
    """The inputs of a model in one window of a partner's motion, and where its output goes.

    Parameters
    ----------
    partner : index of the partner
    motion : spline of the partner's motion in the world
    window : Window
    frame : of the partner at the window's start
    noise : (S, k, 2 K) coefficients; empty for the GRU
    action : index of the label; 0 where labels are no condition
    rows : of the reaction
    out_times : (rows,) float64, seconds
    weights : (rows,) float64, weight of the window in the cross-fade
    """

    partner: int
    motion: Spline
    window: Window
    frame: Frame
    noise: Tensor
    action: int
    rows: slice
    out_times: NDArray[np.float64]
    weights: NDArray[np.float64]

    def sample_partner(self, times: NDArray[np.float64]) -> NDArray[np.float32]:
        """``(N, 3 J)``: the partner's poses at times, in the window's frame."""
        return self.frame.to_local(sample_poses(self.motion, times)).reshape(len(times), -1)


def mean_duration(normalisation: Normalisation) -> float:
    """Geometric mean of the training clips' durations, seconds."""
    return math.exp(float(normalisation.log_duration[0]))


def max_duration(normalisation: Normalisation) -> float:
    """Longest duration that is not divided into windows, seconds."""
    mean, deviation = normalisation.log_duration.tolist()
    return math.exp(mean + MAX_DURATION_STDS * deviation)


def split_into_windows(start: float, end: float, normalisation: Normalisation) -> list[Window]:
    """Return one window up to ``max_duration``; else evenly spaced ones of ``mean_duration``.

    Raises
    ------
    ValueError
        If there were more than ``MAX_WINDOWS``.
    """
    total = end - start
    if total <= max_duration(normalisation):
        return [Window(start, total)]
    duration = mean_duration(normalisation)
    ratio = 2 * (total - duration) / max(duration, sys.float_info.min)
    if not ratio < MAX_WINDOWS:
        reason = f"{total:g} s are too long for a model of clips of {duration:g} s"
        raise ValueError(f"{reason}: wanted at most {MAX_WINDOWS} windows")
    count = math.ceil(ratio) + 1
    return [Window(float(first), duration) for first in np.linspace(start, end - duration, count)]


def window_weights(windows: list[Window], times: NDArray[np.float64]) -> list[WindowWeights]:
    """Return each window's cross-fade weights; at every time they sum to one.

    The weights are those of a Hann window, but constant in the first half of the first window and
    the second half of the last.

    Parameters
    ----------
    times : (T,) ascending, seconds
    """
    weighted, total = [], np.zeros(len(times))
    for i, window in enumerate(windows):
        tolerance = TIME_TOLERANCE * max(1.0, abs(window.end))
        first, last = np.searchsorted(times, [window.start - tolerance, window.end + tolerance])
        x = window.normalise(times[first:last])
        weights = _hann_weights(x, first=i == 0, last=i == len(windows) - 1)
        total[first:last] += weights
        weighted.append((slice(int(first), int(last)), weights))
    return [(rows, weights / total[rows]) for rows, weights in weighted]


class ContinuousNoise:
    """One realisation of the random field over all time, computed window by window.

    Coefficients are interpolated between independent samples, ``NOISE_INTERVAL`` windows apart, as
    ``cos(a) first + sin(a) second``, which keeps their distribution: in every window the noise is
    distributed as in training, and in windows that overlap it is nearly the same function.

    Parameters
    ----------
    field : GaussianRandomField
    sample : returns independent coefficients, of any shape ``(..., 2 K)``
    """

    def __init__(self, field: GaussianRandomField, sample: Callable[[], Tensor]) -> None:
        self._field, self._sample = field, sample
        self._last_two = deque[Tensor](maxlen=2)
        self._n_sampled = 0

    def coefficients(self, start: float) -> Tensor:
        """Return the coefficients of a window.

        Parameters
        ----------
        start : of the window, in windows from the beginning; not before that of the last call
        """
        number, fraction = divmod(start / NOISE_INTERVAL, 1)
        result = self._independent(int(number))
        if fraction:
            angle = math.pi / 2 * fraction * fraction * (3 - 2 * fraction)
            later = self._independent(int(number) + 1)
            result = math.cos(angle) * result + math.sin(angle) * later
        return self._field.shift(result, start) if start else result

    def _independent(self, number: int) -> Tensor:
        while self._n_sampled <= number:
            self._last_two.append(self._sample())
            self._n_sampled += 1
        return self._last_two[number - self._n_sampled]


def window_queries(
    model: ReactionModel, partners: Sequence[PartnerMotion], n_samples: int, random: torch.Generator
) -> Iterator[WindowQuery]:
    """Yield the queries of all windows of each partner in turn."""
    for number, partner in enumerate(partners):
        motion = SmoothingSpline(partner.times, partner.motion)
        motion.check(partner.out_times)
        windows = split_into_windows(motion.start, motion.end, model.normalisation)
        noise = continuous_noise(model, n_samples, random)
        action = action_index(model, partner.action)
        for window, (rows, weights) in zip(
            windows, window_weights(windows, partner.out_times), strict=True
        ):
            if not len(weights):
                continue  # no output time is in this window
            start = (window.start - motion.start) / window.duration
            yield WindowQuery(
                partner=number,
                motion=motion,
                window=window,
                frame=body_frame(sample_poses(motion, np.array([window.start])), model.skeleton),
                noise=noise.coefficients(start) if noise else torch.zeros(0),
                action=action,
                rows=rows,
                out_times=partner.out_times[rows],
                weights=weights,
            )


def continuous_noise(
    model: ReactionModel, n_samples: int, random: torch.Generator
) -> ContinuousNoise | None:
    """Build the noise of S reactions to one partner; None for the GRU.

    Each sample has a generator of its own, so that it is the same however many there are.

    Raises
    ------
    ValueError
        If ``n_samples`` is less than 1, or not 1 for a deterministic model.
    """
    if n_samples < 1 or (is_deterministic(model) and n_samples != 1):
        wanted = "1: the model is deterministic" if is_deterministic(model) else "1 or more"
        raise ValueError(f"n_samples must be {wanted}; got {n_samples}")
    if isinstance(model, Gru):
        return None
    seeds = torch.randint(MAX_SEED, (n_samples,), generator=random).tolist()
    generators = [torch.Generator().manual_seed(seed) for seed in seeds]
    return ContinuousNoise(
        model.config.noise,
        lambda: torch.cat([model.sample_noise(1, generator) for generator in generators]),
    )


def is_deterministic(model: ReactionModel) -> bool:
    """Whether a model takes no noise and so has one reaction to a partner."""
    return isinstance(model, Gru) or not model.config.noise_channels


def gives_one(model: ReactionModel) -> bool:
    """Whether a model has one reaction to a partner: it takes no noise, or its temperature is 0."""
    return is_deterministic(model) or (not isinstance(model, Gru) and not float(model.temperature))


def set_temperature(model: ReactionModel, temperature: float) -> None:
    """Set the standard deviation of the noise that reactions are sampled from.

    Raises
    ------
    ValueError
        If the model has no noise, or the temperature is not 0 to ``MAX_TEMPERATURE``.
    """
    if isinstance(model, Gru) or is_deterministic(model):
        raise ValueError(f"the model has no noise, and so no temperature; got {temperature:g}")
    if not 0 <= temperature <= MAX_TEMPERATURE:
        raise ValueError(f"temperature must be 0 to {MAX_TEMPERATURE:g}; got {temperature:g}")
    model.temperature.fill_(temperature)


def known_actions(model: ReactionModel) -> tuple[str, ...]:
    """Return the labels that a model may be given; none if labels are no condition."""
    return () if isinstance(model, Gru) else model.config.actions


def needs_label(model: ReactionModel) -> bool:
    """Whether a model reacts with a label alone."""
    known = known_actions(model)
    return bool(known) and UNLABELLED not in known


def action_index(model: ReactionModel, action: str) -> int:
    """Return the index of a label, or of the only one that contains the words; 0 without labels."""
    known = known_actions(model)
    if not known and not action:
        return 0
    matching = [label for label in known if action and action.lower() in label.lower()]
    meant = matching[0] if len(matching) == 1 and action not in known else action
    return int(action_indices([meant], known))


def sample_poses(motion: Spline, times: NDArray[np.float64]) -> Motion:
    """``(N, J, 3)`` float32: the poses of a motion at times."""
    poses: Motion = motion(times).astype(np.float32)
    return poses


def _hann_weights(x: NDArray[np.float64], *, first: bool, last: bool) -> NDArray[np.float64]:
    """Return a Hann window of normalised time, constant where no other window overlaps."""
    weights: NDArray[np.float64] = np.sin(np.pi * x.clip(1e-6, 1 - 1e-6)) ** 2
    if first:
        weights[x < 0.5] = 1
    if last:
        weights[x >= 0.5] = 1
    return weights
