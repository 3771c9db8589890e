"""Tables of metrics with intervals, for the page and as Markdown."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from pacmo_core.figures.columns import (
    CLOSER,
    HIGHER,
    LOWER,
    METRICS,
    REFERENCES,
    ROWS,
    UNKNOWN,
    Metric,
)

Cell = Mapping[str, float | str | None]  # mean, low, high; without a mean, the reason as "missing"
Rows = Mapping[str, Mapping[str, Cell]]

_NO_VALUE, _NO_REASON = "–", "not computed for this row"


@dataclass(frozen=True)
class Entry:
    """One cell as shown, the interval in one line or several.

    ``mark`` is ``best``, ``level`` (interval meets the best's) or empty.
    """

    value: str
    interval: str
    mark: str
    reason: str


@dataclass(frozen=True)
class Line:
    """One row as shown."""

    label: str
    meaning: str
    is_model: bool
    entries: tuple[Entry, ...]


@dataclass(frozen=True)
class Table:
    """A table as shown: the metrics are the columns."""

    metrics: tuple[Metric, ...]
    lines: tuple[Line, ...]

    @property
    def reasons(self) -> list[str]:
        """Why values are missing, each reason once, in the order of the cells."""
        given = [entry.reason for line in self.lines for entry in line.entries if entry.reason]
        return list(dict.fromkeys(given))


def table(rows: Rows) -> Table:
    """Lay out rows of metrics, marking the best model of each column.

    Known rows and metrics come first, in the order of this module; others follow in their own.
    The real motion, the oracle and wrong partners are references and are never marked; nor is a
    model that has no rival, nor a metric whose better direction is not known.
    """
    names = _known_first(ROWS, rows)
    columns = _known_first(METRICS, {key: None for row in rows.values() for key in row})
    marks = {column: _marks(rows, column) for column in columns}
    return Table(
        metrics=tuple(METRICS.get(c, Metric(c, UNKNOWN, "", "")) for c in columns),
        lines=tuple(
            Line(
                *ROWS.get(name, (name, "")),
                is_model=name not in REFERENCES,
                entries=tuple(
                    entry_of(rows[name].get(c, {}), marks[c].get(name, "")) for c in columns
                ),
            )
            for name in names
        ),
    )


def markdown_table(rows: Rows) -> str:
    """Write rows of metrics as a Markdown table: the best model bold, ``≈`` where level with it."""
    shown = table(rows)
    head = ["", *(f"{_plain(m.label)} {m.better}".strip() for m in shown.metrics)]
    body = [[_plain(line.label), *map(_markdown, line.entries)] for line in shown.lines]
    ruler = ["---", *["---:"] * len(shown.metrics)]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in [head, ruler, *body]) + "\n"


def number(value: float) -> str:
    """Write a number short: three digits that count, a true minus."""
    size = abs(value)
    if size and not 1e-3 <= size < 1e5:
        text = f"{value:.1e}".replace("e-0", "e-").replace("e+0", "e")
    else:
        text = f"{value:.0f}" if size >= 100 else f"{value:#.3g}".removesuffix(".") if size else "0"
    return text.replace("-", "−")


def _known_first(known: Mapping[str, object], given: Mapping[str, object]) -> list[str]:
    return [key for key in known if key in given] + [key for key in given if key not in known]


def number_in(cell: Cell, key: str) -> float | None:
    """Give a figure of a cell; none where there is none, or it is no number."""
    value = cell.get(key)
    if isinstance(value, str) or value is None or math.isnan(value):
        return None
    return float(value)


def entry_of(cell: Cell, mark: str) -> Entry:
    """Write a cell: the mean, its interval, or a dash and the reason."""
    mean, low, high = (number_in(cell, key) for key in ("mean", "low", "high"))
    if mean is None:
        return Entry(_NO_VALUE, "", "", str(cell.get("missing") or _NO_REASON))
    interval = "" if low is None or high is None else f"{number(low)} … {number(high)}"
    return Entry(number(mean), interval, mark, "")


def _marks(rows: Rows, column: str) -> dict[str, str]:
    """Say which models are best in a column, and whose intervals meet the best's."""
    better = METRICS[column].better if column in METRICS else UNKNOWN
    real = number_in(rows.get("real", {}).get(column, {}), "mean")
    cells = {name: row.get(column, {}) for name, row in rows.items() if name not in REFERENCES}
    means = {name: m for name, cell in cells.items() if (m := number_in(cell, "mean")) is not None}
    if len(means) < 2 or better == UNKNOWN or (better == CLOSER and real is None):
        return {}
    away = {LOWER: means, HIGHER: {name: -m for name, m in means.items()}}.get(
        better, {name: abs(m - (real or 0.0)) for name, m in means.items()}
    )
    best = min(away, key=away.__getitem__)
    level = {name: "level" for name in means if name != best and _meet(cells[name], cells[best])}
    return {best: "best"} | level


def _meet(one: Cell, other: Cell) -> bool:
    ends = [number_in(cell, key) for cell in (one, other) for key in ("low", "high")]
    low, high, other_low, other_high = ends
    if low is None or high is None or other_low is None or other_high is None:
        return False
    return low <= other_high and other_low <= high


def _markdown(entry: Entry) -> str:
    value = f"**{entry.value}**" if entry.mark == "best" else entry.value
    level = "≈ " if entry.mark == "level" else ""
    return f"{level}{value}" + (f" ({entry.interval})" if entry.interval else "")


def _plain(text: str) -> str:
    """Keep a name from breaking out of its cell."""
    return " ".join(text.replace("\\", "\\\\").replace("|", "\\|").split())
