"""Tables of metrics with intervals, for the page and as Markdown, and of paired differences."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pacmo_core.metrics.catalogue import (
    CLOSER_TO_REAL,
    HIGHER,
    LOWER,
    METRICS,
    REFERENCE_ROWS,
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
        reasons = [entry.reason for line in self.lines for entry in line.entries if entry.reason]
        return list(dict.fromkeys(reasons))


def metrics_table(rows: Rows) -> Table:
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
                is_model=name not in REFERENCE_ROWS,
                entries=tuple(
                    make_entry(rows[name].get(c, {}), marks[c].get(name, "")) for c in columns
                ),
            )
            for name in names
        ),
    )


def markdown_table(rows: Rows) -> str:
    """Write rows of metrics as a Markdown table: the best model bold, ``≈`` where level with it."""
    selected = metrics_table(rows)
    head = ["", *(f"{_plain(m.label)} {m.better}".strip() for m in selected.metrics)]
    body = [[_plain(line.label), *map(_markdown, line.entries)] for line in selected.lines]
    ruler = ["---", *["---:"] * len(selected.metrics)]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in [head, ruler, *body]) + "\n"


def format_number(value: float) -> str:
    """Write a number short: three digits that count, a true minus."""
    size = abs(value)
    if size and not 1e-3 <= size < 1e5:
        text = f"{value:.1e}".replace("e-0", "e-").replace("e+0", "e")
    else:
        text = f"{value:.0f}" if size >= 100 else f"{value:#.3g}".removesuffix(".") if size else "0"
    return text.replace("-", "−")


def _known_first(known: Mapping[str, object], given: Mapping[str, object]) -> list[str]:
    return [key for key in known if key in given] + [key for key in given if key not in known]


def finite_value(cell: Cell, key: str) -> float | None:
    """Give a figure of a cell; none where there is none, or it is no number."""
    value = cell.get(key)
    if isinstance(value, str) or value is None or math.isnan(value):
        return None
    return float(value)


def make_entry(cell: Cell, mark: str) -> Entry:
    """Write a cell: the mean, its interval, or a dash and the reason."""
    mean, low, high = (finite_value(cell, key) for key in ("mean", "low", "high"))
    if mean is None:
        return Entry(_NO_VALUE, "", "", str(cell.get("missing") or _NO_REASON))
    interval = (
        "" if low is None or high is None else f"{format_number(low)} … {format_number(high)}"
    )
    return Entry(format_number(mean), interval, mark, "")


def _marks(rows: Rows, column: str) -> dict[str, str]:
    """Say which models are best in a column, and whose intervals meet the best's."""
    better = METRICS[column].better if column in METRICS else UNKNOWN
    real = finite_value(rows.get("real", {}).get(column, {}), "mean")
    cells = {name: row.get(column, {}) for name, row in rows.items() if name not in REFERENCE_ROWS}
    means = {
        name: m for name, cell in cells.items() if (m := finite_value(cell, "mean")) is not None
    }
    if len(means) < 2 or better == UNKNOWN or (better == CLOSER_TO_REAL and real is None):
        return {}
    away = {LOWER: means, HIGHER: {name: -m for name, m in means.items()}}.get(
        better, {name: abs(m - (real or 0.0)) for name, m in means.items()}
    )
    best = min(away, key=away.__getitem__)
    level = {name: "level" for name in means if name != best and _overlap(cells[name], cells[best])}
    return {best: "best"} | level


def _overlap(one: Cell, other: Cell) -> bool:
    ends = [finite_value(cell, key) for cell in (one, other) for key in ("low", "high")]
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


BETWEEN = "_minus_"
_REASON: Cell = {"missing": "the same by definition, or not measured"}


def difference_table(differences: Rows) -> Table:
    """Lay out differences ``FIRST_minus_SECOND``; marked where the first is better for certain.

    An interval that reaches zero marks nothing, nor does a metric without a better direction.
    """
    return _transposed_table(
        differences, {name: _difference_label(name) for name in differences}, _first_is_better
    )


def sensitivity_table(sensitivity: Rows, labels: Mapping[str, str]) -> Table:
    """Lay out true pairs less wrong ones; marked where the metric tells them apart.

    Parameters
    ----------
    sensitivity : comparison to metric to ``{mean, low, high, sees}``
    labels : what each comparison is called
    """
    return _transposed_table(sensitivity, labels, lambda cell, _: bool(cell.get("sensitive")))


def insensitive_metrics(cells: Mapping[str, Cell]) -> list[str]:
    """Name the metrics of one comparison that do not tell true pairs from wrong ones."""
    return [
        METRICS[name].label for name in METRICS if name in cells and not cells[name]["sensitive"]
    ]


def _transposed_table(
    columns: Rows, labels: Mapping[str, str], marked: Callable[[Cell, str], bool]
) -> Table:
    """Make a column of each comparison and a line of each metric that the page knows."""
    selected = [name for name in METRICS if any(name in cells for cells in columns.values())]
    lines = []
    for name in selected:
        cells = [column.get(name, _REASON) for column in columns.values()]
        entries = tuple(make_entry(cell, "best" if marked(cell, name) else "") for cell in cells)
        metric = METRICS[name]
        label = " ".join(filter(None, (metric.label, metric.better, metric.unit)))
        lines.append(Line(label, "", is_model=False, entries=entries))
    heads = tuple(Metric(labels.get(name, name), UNKNOWN, "", "") for name in columns)
    return Table(heads, tuple(lines))


def _difference_label(name: str) -> str:
    first, _, second = name.partition(BETWEEN)
    return " − ".join(ROWS.get(row, (row, ""))[0] for row in (first, second))


def _first_is_better(cell: Cell, name: str) -> bool:
    low, high = finite_value(cell, "low"), finite_value(cell, "high")
    if low is None or high is None:
        return False
    return {LOWER: high < 0, HIGHER: low > 0}.get(METRICS[name].better, False)


AUGMENTATION_TITLE = "Does augmentation pay?"
AUGMENTATION_HEADS = (
    Metric("With variations", UNKNOWN, "", ""),
    Metric("Without", UNKNOWN, "", ""),
    Metric("Difference, over clips", UNKNOWN, "", "interval: other clips of the same people"),
    Metric("Difference, over folds", UNKNOWN, "", "interval: other people, other trainings"),
    Metric("Better in", UNKNOWN, "", "folds"),
)
BETTER, WORSE, OPEN = "better", "worse", "open"


def augmentation_table(pooled: Mapping[str, Any]) -> Table:
    """Lay out a line a metric.

    Marked: with variations it is better for certain over folds, its interval clear of zero.

    Parameters
    ----------
    pooled : ``with``, ``without``, ``clips``, ``folds``: metric to cell; ``each``: metric to the
        differences fold by fold
    """
    lines = []
    for name in _known_metrics(pooled):
        metric = METRICS[name]
        label = " ".join(filter(None, (metric.label, metric.better, metric.unit)))
        mark = "best" if metric_verdict(name, pooled["folds"].get(name, {})) == BETTER else ""
        entries = (
            *(make_entry(pooled[part].get(name, {}), "") for part in ("with", "without", "clips")),
            make_entry(pooled["folds"].get(name, {}), mark),
            make_entry(_count_improved(name, pooled["each"][name]), ""),
        )
        lines.append(Line(label, metric.meaning, is_model=False, entries=entries))
    return Table(AUGMENTATION_HEADS, tuple(lines))


def augmentation_verdict(pooled: Mapping[str, Any]) -> str:
    """Say in a sentence whether it pays, whichever way that is."""
    result: dict[str, list[str]] = {BETTER: [], WORSE: [], OPEN: []}
    for name in _known_metrics(pooled):
        if METRICS[name].better in (LOWER, HIGHER):
            result[metric_verdict(name, pooled["folds"].get(name, {}))].append(METRICS[name].label)
    if result[BETTER] and result[WORSE]:
        head = "It pays in some metrics and costs in others"
    elif result[BETTER]:
        head = "It pays"
    elif result[WORSE]:
        head = "It does not pay: it costs"
    else:
        head = "It is not shown to pay, nor to cost"
    said = [
        f"{what} for certain in {', '.join(result[what])}"
        for what in (BETTER, WORSE)
        if result[what]
    ]
    said.append(f"undecided in {len(result[OPEN])} of {sum(map(len, result.values()))} metrics")
    return f"{head}; {'; '.join(said)}."


def metric_verdict(name: str, cell: Cell) -> str:
    """Say which way a difference is clear of zero: better, worse, or open."""
    low, high = finite_value(cell, "low"), finite_value(cell, "high")
    sign = {LOWER: -1, HIGHER: 1}.get(METRICS[name].better, 0)
    if low is None or high is None or not sign or low <= 0 <= high:
        return OPEN
    return BETTER if sign * low > 0 else WORSE


def _known_metrics(pooled: Mapping[str, Any]) -> list[str]:
    return [name for name in METRICS if name in pooled["each"]]


def _count_improved(name: str, differences: Sequence[float]) -> Cell:
    sign = {LOWER: -1, HIGHER: 1}.get(METRICS[name].better, 0)
    if not sign:
        return {"missing": "which way is better, a difference does not tell"}
    return {"mean": float(sum(sign * value > 0 for value in differences))}
