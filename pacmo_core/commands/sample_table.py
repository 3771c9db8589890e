"""Measurements of samples: a table with a column for each, and lines on those beyond a limit."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import inf

import numpy as np

from pacmo_core.figures.numbers import format_fixed

RIGHT_ACTION = "no limit tells whether the action is right: look at the motion"
# Samples with a line each; more of them have one line together.
MAX_LINES = 4
# Samples with a column each.
MAX_COLUMNS = 8
# Numbers of samples in a line.
MAX_NUMBERS = 12


@dataclass(frozen=True)
class Measurement:
    """A measurement of every sample, and its limit if it has one.

    Parameters
    ----------
    name : in the table, with the unit
    values : (S,) in the printed unit
    limit : the largest that is wanted; infinity where no value is wrong
    text : what is beyond the limit, with ``{}`` in place of the value
    unit : of value and limit, with a space before it if there is one
    places : (S,) where each value is, such as its frame; empty if it is of the whole motion
    decimals : of the values
    partner : the same of the partner, if it has one
    partner_place : where that is
    limits : other limits than ``limit``, of samples by their numbers
    """

    name: str
    values: Sequence[float]
    limit: float = inf
    text: str = ""
    unit: str = ""
    places: Sequence[str] = ()
    decimals: int = 1
    partner: float | None = None
    partner_place: str = ""
    limits: Mapping[int, float] = field(default_factory=dict)

    def wanted(self, numbers: Sequence[int]) -> str:
        """Return the limit of some samples in words: one value, or least and greatest."""
        limits = [f"{limit:.3g}" for limit in sorted({self._limit_of(one) for one in numbers})]
        return f"wanted at most {' to '.join(limits[:: max(1, len(limits) - 1)])}{self.unit}"

    def _limit_of(self, number: int) -> float:
        return self.limits.get(number, self.limit)

    @property
    def beyond(self) -> list[int]:
        """The numbers of the samples beyond the limit, the worst first."""
        order = np.argsort([-value for value in self.values], kind="stable").tolist()
        # As printed: 12.51 beside a limit of 12.5 would read as equal.
        return [
            number
            for number in order
            if self.limit < inf
            and round(self.values[number], self._places)
            > round(self._limit_of(number), self._places)
        ]

    @property
    def _places(self) -> int:
        """Decimals of a value: at least as many as the limit has, or 7.63 beyond 7.61 is 7.6."""
        of_limit = "" if self.limit == inf else f"{self.limit:.3g}".partition(".")[2]
        return max(self.decimals, len(of_limit))

    @property
    def is_beyond_in_all(self) -> bool:
        """Whether several samples are beyond the limit and none is within it."""
        return len(self.beyond) == len(self.values) > 1

    def said(self, numbers: Sequence[int]) -> str:
        """Return the measurement of some samples in words: one value, or least and greatest."""
        return self.text.format(self.range_of(numbers))

    def range_of(self, numbers: Sequence[int], unit: str | None = None) -> str:
        """Return one value, or the least and the greatest of some samples, with the unit."""
        values = format_range([self.values[number] for number in numbers], self._places)
        return f"{values}{self.unit if unit is None else unit}"

    def cells(self, numbers: Sequence[int]) -> list[str]:
        """Return the row of the table: name, limit, the partner's value and those of samples."""
        wanted = "" if self.limit == inf else f"<= {self.limit:.3g}"
        own = "" if self.partner is None else format_fixed(self.partner, self._places)
        return [self.name, wanted, own, *(self.range_of([number], "") for number in numbers)]

    def lines(self) -> list[str]:
        """Return a line for each sample beyond the limit; one line if they are many, or all."""
        beyond, count = self.beyond, len(self.values)
        if len(beyond) <= MAX_LINES and not self.is_beyond_in_all:
            return [
                f"{self._sample(number, f': {self.said([number])}')}, {self.wanted([number])}"
                for number in sorted(beyond)
            ]
        those = _those(count) if self.is_beyond_in_all else f"{len(beyond)} of {count} samples"
        worst = "; ".join(self._sample(number) for number in beyond[:MAX_LINES])
        more = "; ..." if beyond[MAX_LINES:] else ""
        texts = {self.range_of([number]) for number in beyond}
        order = "alike" if len(texts) == 1 else "the worst first"
        return [f"{those}: {self.said(beyond)}, {self.wanted(beyond)} ({order}: {worst}{more})"]

    def _sample(self, number: int, said: str = "") -> str:
        place = f", {self.places[number]}" if self.places else ""
        return f"sample {number}{said}{place}"


def within_limits(limits: Sequence[Measurement]) -> list[int]:
    """Return the numbers of the samples within every limit, of which there is at least one."""
    beyond = {number for one in limits for number in one.beyond}
    return [number for number in range(len(limits[0].values)) if number not in beyond]


def limit_lines(limits: Sequence[Measurement], untouched: Sequence[int]) -> list[str]:
    """Return the lines of all limits, and one on what to do; one if all samples are within.

    Parameters
    ----------
    limits : at least one
    untouched : numbers of the samples in which neither's hand touches the other
    """
    lines = [line for one in limits for line in one.lines()]
    count = len(limits[0].values)
    where = f"in {_samples(untouched)} " if len(untouched) < count else ""
    without = [f"{where}no hand touches the other person"] if untouched else []
    if not lines:
        return ["; ".join([f"within every limit: {_those(count)}", *without, RIGHT_ACTION])]
    part = "a part of the capture (pacmo export --seconds) or another one"
    if any(one.is_beyond_in_all for one in limits):
        hint = (
            f"where all samples are beyond a limit another --seed hardly helps: try {part}, or "
            "train on captures like this one (docs/react.md)"
        )
        return [*lines, "; ".join([*without, hint])]
    within = within_limits(limits)
    of_none = ["no sample is within every limit"] if count > 1 else []
    within_text = [f"within every limit: {_samples(within)}"] if within else of_none
    other = (
        "other samples"
        if count > 1
        else f"another sample; where --samples 3 are all beyond it, try {part}"
    )
    return [*lines, "; ".join([*within_text, *without, f"another --seed gives {other}"])]


def _those(count: int) -> str:
    return {1: "the reaction", 2: "both samples"}.get(count, f"all {count} samples")


def _samples(numbers: Sequence[int]) -> str:
    return f"sample{'s' * (len(numbers) > 1)} {listed(numbers)}"


def listed(numbers: Sequence[object]) -> str:
    """List numbers of samples, or values of each, if they are not too many."""
    return f"{', '.join(map(str, numbers[:MAX_NUMBERS]))}{', ...' * bool(numbers[MAX_NUMBERS:])}"


def samples_of(texts: Sequence[str], worst: int) -> str:
    """Say which samples have the value of the worst, as values are printed.

    Returns
    -------
    ``sample 1`` or ``samples 0, 2``; ``all samples`` where values are alike; empty of one sample
    """
    same = [number for number, text in enumerate(texts) if text == texts[worst]]
    if len(texts) == 1:
        return ""
    if len(same) == len(texts):
        return "all samples"
    return _samples(same)


def format_range(values: Sequence[float], decimals: int) -> str:
    """Format one value, or the least and the greatest."""
    low, high = (format_fixed(value, decimals) for value in (min(values), max(values)))
    return low if low == high else f"{low} to {high}"


def table_lines(rows: Sequence[Measurement]) -> list[str]:
    """Lay measurements out in columns: of each sample, or the least and the greatest of many."""
    count = len(rows[0].values)
    if count <= MAX_COLUMNS:
        heads = [f"sample {number}" for number in range(count)]
        cells = [row.cells(range(count)) for row in rows]
    else:
        heads = ["least", f"greatest of {count}"]
        ends = [(int(np.argmin(row.values)), int(np.argmax(row.values))) for row in rows]
        cells = [row.cells(of_row) for row, of_row in zip(rows, ends, strict=True)]
    lines = [["", "wanted", "partner", *heads], *cells]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return [
        "  ".join([name.ljust(widths[0]), *map(str.rjust, values, widths[1:])])
        for name, *values in lines
    ]
