"""Training curves as small charts, one per term, each with its own axis."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pacmo_core.figures.numbers import format_number, format_tick

_WIDTH, _HEIGHT = 300.0, 150.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 54.0, 16.0, 8.0, 20.0
_MAX_POINTS = 240  # of a chart; more are not visible
_LOG_FROM = 100.0  # ratio of the largest to the smallest value from which the axis is logarithmic
# What the axis spans at least, relative to the largest value: noise of a few percent looks flat.
_MIN_SPAN = 0.5
_MAX_DOTS = 12  # points up to which each is marked


@dataclass(frozen=True)
class Curve:
    """The logged values of a training run.

    Parameters
    ----------
    steps : (N,) increasing, N >= 1
    terms : (N,) values by name; NaN where a term was not measured
    x_label : unit of the steps
    intervals : lower and upper ends by name, (N,) each, of terms that have them

    Raises
    ------
    ValueError
        If a term has another length than ``steps``, or there are no steps.
    """

    steps: Sequence[float]
    terms: Mapping[str, Sequence[float]]
    x_label: str = "step"
    intervals: Mapping[str, tuple[Sequence[float], Sequence[float]]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        wrong = {name: len(term) for name, term in self.terms.items()}
        if not self.steps or any(n != len(self.steps) for n in wrong.values()):
            raise ValueError(
                f"a curve needs at least one step and one value per step; "
                f"got {len(self.steps)} steps and {wrong}"
            )


@dataclass(frozen=True)
class Tick:
    """A tick on an axis: its position in the chart and its label."""

    at: float
    text: str


@dataclass(frozen=True)
class Chart:
    """One term as SVG paths and ticks in a chart of ``width`` by ``height``.

    ``dots`` are the points of a short curve; ``band`` is the interval, or the range of what a point
    of a long curve stands for.
    """

    name: str
    x_label: str
    is_log: bool
    last: str
    line: str
    band: str
    dots: tuple[tuple[float, float], ...]
    x_ticks: tuple[Tick, ...]
    y_ticks: tuple[Tick, ...]
    width: float = _WIDTH
    height: float = _HEIGHT
    left: float = _LEFT
    right: float = _WIDTH - _RIGHT
    bottom: float = _HEIGHT - _BOTTOM


def charts(curve: Curve) -> list[Chart]:
    """Return a chart of every term that was measured at least once."""
    steps = np.asarray(curve.steps, dtype=np.float64)
    result = []
    for name, term in curve.terms.items():
        values = np.asarray([term, *curve.intervals.get(name, (term, term))], dtype=np.float64)
        known = np.isfinite(values[0])
        if known.any():
            middle = values[0, known]
            ends = np.where(np.isfinite(values[1:, known]), values[1:, known], middle)
            result.append(_chart(name, curve.x_label, steps[known], np.stack([middle, *ends])))
    return result


def _chart(
    name: str, x_label: str, steps: NDArray[np.float64], values: NDArray[np.float64]
) -> Chart:
    """Return the chart of a term: ``values`` (3, N) are its own and the ends of its intervals."""
    log = values.min() > 0 and values.max() / _LOG_FROM > values.min()
    bins = np.array_split(np.arange(len(steps)), min(len(steps), _MAX_POINTS))
    scaled = np.log10(values) if log else values
    x = _Axis.over(steps, _LEFT, _WIDTH - _RIGHT)
    y = _Axis.over(scaled, _HEIGHT - _BOTTOM, _TOP, min_span=0.0 if log else _MIN_SPAN)
    across = [x.place(steps[b].mean()) for b in bins]
    middle = [y.place(scaled[0, b].mean()) for b in bins]
    low = [y.place(scaled[:, b].min()) for b in bins]
    high = [y.place(scaled[:, b].max()) for b in bins]
    points = [(round(a, 1), round(b, 1)) for a, b in zip(across, middle, strict=True)]
    return Chart(
        name=name,
        x_label=x_label,
        is_log=bool(log),
        last=format_number(float(values[0, -1])),
        line=_svg_path(across, middle),
        band=_svg_path(across + across[::-1], high + low[::-1]) + "Z",
        dots=tuple(points) if len(points) <= _MAX_DOTS else (),
        x_ticks=x.ticks(min_step=1.0 if (steps == steps.round()).all() else 0.0),
        y_ticks=y.ticks(log=bool(log), min_step=1.0 if log else 0.0),
    )


@dataclass(frozen=True)
class _Axis:
    low: float
    high: float
    start: float
    stop: float

    @classmethod
    def over(
        cls, values: NDArray[np.float64], start: float, stop: float, min_span: float = 0.0
    ) -> "_Axis":
        """Return an axis over all values that spans at least a share of the largest size."""
        low, high = float(values.min()), float(values.max())
        span = min_span * max(abs(low), abs(high))
        if low == high:
            span = max(span, abs(low), 1e-6)
        margin = max(0.0, span - (high - low)) / 2
        return cls(low - margin, high + margin, start, stop)

    def place(self, value: float) -> float:
        fraction = (value - self.low) / (self.high - self.low)
        return self.start + fraction * (self.stop - self.start)

    def ticks(self, *, min_step: float, log: bool = False) -> tuple[Tick, ...]:
        """Return a few ticks: 1, 2 or 5 times a power of ten; powers of ten if logarithmic."""
        rough = max((self.high - self.low) / 4, min_step)
        power = 10.0 ** np.floor(np.log10(rough))
        step = power * next(m for m in (1, 2, 5, 10) if m * power >= rough)
        values = np.arange(np.ceil(self.low / step), np.floor(self.high / step) + 1) * step
        return tuple(
            Tick(round(self.place(float(v)), 2), format_tick(float(10**v if log else v)))
            for v in values
        )


def _svg_path(x: Sequence[float], y: Sequence[float]) -> str:
    points = [f"{a:.1f} {b:.1f}" for a, b in zip(x, y, strict=True)]
    return "M" + "L".join(points)
