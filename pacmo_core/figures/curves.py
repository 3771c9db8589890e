"""Training curves as small charts, one per term, each with its own axis."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pacmo_core.figures.tables import format_number

_WIDTH, _HEIGHT = 300.0, 150.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 44.0, 16.0, 8.0, 20.0
_MAX_POINTS = 240  # of a chart; more are not visible
_LOG_FROM = 100.0  # ratio of the largest to the smallest value from which the axis is logarithmic


@dataclass(frozen=True)
class Curve:
    """The logged values of a training run.

    Parameters
    ----------
    steps : (N,) increasing, N >= 1
    terms : (N,) values by name; NaN where a term was not measured
    x_label : unit of the steps

    Raises
    ------
    ValueError
        If a term has another length than ``steps``, or there are no steps.
    """

    steps: Sequence[float]
    terms: Mapping[str, Sequence[float]]
    x_label: str = "step"

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
    """One term as SVG paths and ticks in a chart of ``width`` by ``height``."""

    name: str
    x_label: str
    is_log: bool
    last: str
    line: str
    band: str
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
        values = np.asarray(term, dtype=np.float64)
        known = np.isfinite(values)
        if known.any():
            result.append(_chart(name, curve.x_label, steps[known], values[known]))
    return result


def _chart(
    name: str, x_label: str, steps: NDArray[np.float64], values: NDArray[np.float64]
) -> Chart:
    log = values.min() > 0 and values.max() / _LOG_FROM > values.min()
    bins = np.array_split(np.arange(len(steps)), min(len(steps), _MAX_POINTS))
    scaled = np.log10(values) if log else values
    x = _Axis.over(steps, _LEFT, _WIDTH - _RIGHT)
    y = _Axis.over(scaled, _HEIGHT - _BOTTOM, _TOP)
    across = [x.place(steps[b].mean()) for b in bins]
    middle = [y.place(scaled[b].mean()) for b in bins]
    low = [y.place(scaled[b].min()) for b in bins]
    high = [y.place(scaled[b].max()) for b in bins]
    return Chart(
        name=name,
        x_label=x_label,
        is_log=bool(log),
        last=format_number(float(values[-1])),
        line=_svg_path(across, middle),
        band=_svg_path(across + across[::-1], high + low[::-1]) + "Z",
        x_ticks=x.ticks(log=False),
        y_ticks=y.ticks(log=bool(log)),
    )


@dataclass(frozen=True)
class _Axis:
    low: float
    high: float
    start: float
    stop: float

    @classmethod
    def over(cls, values: NDArray[np.float64], start: float, stop: float) -> "_Axis":
        low, high = float(values.min()), float(values.max())
        margin = 0.5 * max(abs(low), 1e-6) if low == high else 0.0
        return cls(low - margin, high + margin, start, stop)

    def place(self, value: float) -> float:
        fraction = (value - self.low) / (self.high - self.low)
        return self.start + fraction * (self.stop - self.start)

    def ticks(self, *, log: bool) -> tuple[Tick, ...]:
        """Return a few ticks: 1, 2 or 5 times a power of ten; powers of ten if logarithmic."""
        rough = max((self.high - self.low) / 4, 1.0 if log else 0.0)
        power = 10.0 ** np.floor(np.log10(rough))
        step = power * next(m for m in (1, 2, 5, 10) if m * power >= rough)
        values = np.arange(np.ceil(self.low / step), np.floor(self.high / step) + 1) * step
        return tuple(
            Tick(round(self.place(float(v)), 2), _short_number(float(10**v if log else v)))
            for v in values
        )


def _short_number(value: float) -> str:
    return f"{round(value, 12):g}".replace("-", "−")


def _svg_path(x: Sequence[float], y: Sequence[float]) -> str:
    points = [f"{a:.1f} {b:.1f}" for a, b in zip(x, y, strict=True)]
    return "M" + "L".join(points)
