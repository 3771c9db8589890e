"""Samples beside a limit of what people do: which are beyond it, where, and whether all are."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pacmo_core.figures.numbers import format_fixed

# Samples with a line each; more of them have one line together.
MAX_LINES = 4
# Numbers of samples in a line.
MAX_NUMBERS = 12


@dataclass(frozen=True)
class SampleLimit:
    """A measurement of every sample, and its limit.

    Parameters
    ----------
    values : (S,) in the printed unit
    limit : the largest that is wanted
    text : what is measured, with ``{}`` in place of the value
    unit : of value and limit, with a space before it if there is one
    places : (S,) where each value is, such as its frame; empty if it is of the whole motion
    decimals : of the values
    """

    values: Sequence[float]
    limit: float
    text: str
    unit: str
    places: Sequence[str] = ()
    decimals: int = 1

    @property
    def wanted(self) -> str:
        """The limit, in words."""
        return f"wanted at most {self.limit:.3g}{self.unit}"

    @property
    def beyond(self) -> list[int]:
        """The numbers of the samples beyond the limit, the worst first."""
        order = np.argsort([-value for value in self.values], kind="stable").tolist()
        return [number for number in order if self.values[number] > self.limit]

    @property
    def is_beyond_in_all(self) -> bool:
        """Whether several samples are beyond the limit and none is within it."""
        return len(self.beyond) == len(self.values) > 1

    def said(self, numbers: Sequence[int]) -> str:
        """Return the measurement of some samples in words: one value, or least and greatest."""
        values = format_range([self.values[number] for number in numbers], self.decimals)
        return self.text.format(f"{values}{self.unit}")

    def lines(self) -> list[str]:
        """Return a line for each sample beyond the limit; one line if they are many, or all."""
        beyond, count = self.beyond, len(self.values)
        if len(beyond) <= MAX_LINES and not self.is_beyond_in_all:
            return [
                f"{self._sample(number, f': {self.said([number])}')}, {self.wanted}"
                for number in sorted(beyond)
            ]
        number_text = f"all {count}" if self.is_beyond_in_all else f"{len(beyond)} of {count}"
        worst = "; ".join(self._sample(number) for number in beyond[:MAX_LINES])
        more = "; ..." if beyond[MAX_LINES:] else ""
        return [
            f"{number_text} samples: {self.said(beyond)}, {self.wanted} (the worst first: "
            f"{worst}{more})"
        ]

    def _sample(self, number: int, said: str = "") -> str:
        place = f", {self.places[number]}" if self.places else ""
        return f"sample {number}{said}{place}"


def limit_lines(limits: Sequence[SampleLimit]) -> list[str]:
    """Return the lines of all limits, and one on what to do; nothing if all samples are within."""
    lines = [line for one in limits for line in one.lines()]
    if not lines:
        return []
    if any(one.is_beyond_in_all for one in limits):
        return [*lines, "where all samples are beyond a limit another --seed hardly helps: try "
                "another capture, or train on captures like this one (docs/react.md)"]  # fmt: skip
    beyond = {number for one in limits for number in one.beyond}
    within = [number for number in range(len(limits[0].values)) if number not in beyond]
    numbers = f"{', '.join(map(str, within[:MAX_NUMBERS]))}{', ...' * bool(within[MAX_NUMBERS:])}"
    within_text = [f"samples within every limit: {numbers}"] if within else []
    return [*lines, "; ".join([*within_text, "another --seed gives other samples"])]


def format_range(values: Sequence[float], decimals: int) -> str:
    """Format one value, or the least and the greatest."""
    low, high = (format_fixed(value, decimals) for value in (min(values), max(values)))
    return low if low == high else f"{low} to {high}"
