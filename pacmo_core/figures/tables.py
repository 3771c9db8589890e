"""Tables of metrics with intervals, as HTML and Markdown, and of paired differences."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pacmo_core.figures.numbers import format_number, format_range
from pacmo_core.metrics.catalogue import (
    CLOSER_TO_REAL,
    HIGHER,
    LOWER,
    METRICS,
    REFERENCE_ROWS,
    ROWS,
    UNKNOWN,
    Metric,
    find_metric,
)

Cell = Mapping[str, float | str | None]  # mean, low, high; without a mean, the reason as "missing"
Rows = Mapping[str, Mapping[str, Cell]]

_NO_VALUE, _NO_REASON = "–", "not computed for this row"


@dataclass(frozen=True)
class Entry:
    """One cell as displayed; the interval has one or more lines.

    ``mark`` is ``best``, ``level`` (the interval overlaps that of the best), ``worst`` or empty.
    """

    value: str
    interval: str
    mark: str
    reason: str


@dataclass(frozen=True)
class Line:
    """One row as displayed."""

    label: str
    meaning: str
    is_model: bool
    entries: tuple[Entry, ...]


@dataclass(frozen=True)
class Table:
    """A table as displayed: the metrics are the columns."""

    metrics: tuple[Metric, ...]
    lines: tuple[Line, ...]

    @property
    def reasons(self) -> list[str]:
        """The reasons for missing values, each once, in the order of the cells."""
        reasons = [entry.reason for line in self.lines for entry in line.entries if entry.reason]
        return list(dict.fromkeys(reasons))

    @property
    def meanings(self) -> dict[str, str]:
        """The labels of the columns that have a meaning, by it."""
        labels: dict[str, str] = {}
        for metric in self.metrics:
            if metric.meaning:
                before = labels.get(metric.meaning)
                labels[metric.meaning] = f"{before}, {metric.label}" if before else metric.label
        return labels


def metrics_table(rows: Rows) -> Table:
    """Return a table of rows and metrics, with the best model of each column marked.

    Rows and metrics of the catalogue come first, in its order; others follow in theirs. Real
    motion, the oracle and shuffled partners are references and are never marked; nor are single
    models, nor metrics without a better direction.
    """
    names = _known_first(ROWS, rows)
    columns = _known_first(METRICS, {key: None for row in rows.values() for key in row})
    marks = {column: _marks(rows, column) for column in columns}
    return Table(
        metrics=tuple(find_metric(c) or Metric(c, UNKNOWN, "", "") for c in columns),
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
    """Return a Markdown table: the best model is bold, ``≈`` marks models level with it."""
    table = metrics_table(rows)
    head = ["", *(f"{_plain(m.label)} {m.better}".strip() for m in table.metrics)]
    body = [[_plain(line.label), *map(_markdown, line.entries)] for line in table.lines]
    ruler = ["---", *["---:"] * len(table.metrics)]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in [head, ruler, *body]) + "\n"


def _known_first(known: Mapping[str, object], given: Mapping[str, object]) -> list[str]:
    return [key for key in known if key in given] + [key for key in given if key not in known]


def finite_value(cell: Cell, key: str) -> float | None:
    """Return a value of a cell; None if it is missing or not a number."""
    value = cell.get(key)
    if isinstance(value, str) or value is None or math.isnan(value):
        return None
    return float(value)


def has_interval(cell: Cell) -> bool:
    """Return whether a cell has both bounds; few units have a mean alone."""
    return all(finite_value(cell, key) is not None for key in ("low", "high"))


def make_entry(cell: Cell, mark: str) -> Entry:
    """Format a cell: the mean and its interval, or a dash and the reason."""
    mean, low, high = (finite_value(cell, key) for key in ("mean", "low", "high"))
    if mean is None:
        return Entry(_NO_VALUE, "", "", str(cell.get("missing") or _NO_REASON))
    interval = "" if low is None or high is None else format_range(low, high)
    return Entry(format_number(mean), interval, mark, "")


def _marks(rows: Rows, column: str) -> dict[str, str]:
    """Mark the best model of a column, and those whose intervals overlap that of the best."""
    metric = find_metric(column)
    better = metric.better if metric else UNKNOWN
    real = finite_value(rows.get("real", {}).get(column, {}), "mean")
    cells = {name: row.get(column, {}) for name, row in rows.items() if name not in REFERENCE_ROWS}
    means = {
        name: m for name, cell in cells.items() if (m := finite_value(cell, "mean")) is not None
    }
    if len(means) < 2 or better == UNKNOWN or (better == CLOSER_TO_REAL and real is None):
        return {}
    distances = {LOWER: means, HIGHER: {name: -m for name, m in means.items()}}.get(
        better, {name: abs(m - (real or 0.0)) for name, m in means.items()}
    )
    lowest = [name for name in means if distances[name] == min(distances.values())]
    if len(lowest) > 1:  # none is better than the others
        return dict.fromkeys(lowest, "level") if len(lowest) < len(means) else {}
    (best,) = lowest
    if not has_interval(cells[best]):  # nothing shows that it is better
        return {}
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
    """Escape characters that would end the cell."""
    return " ".join(text.replace("\\", "\\\\").replace("|", "\\|").split())


BETWEEN = "_minus_"
# A metric without a label is in the data, and in no table.
LABELLED = tuple(name for name, metric in METRICS.items() if metric.label)
_ONE_FOLD: Cell = {"missing": "an interval over folds needs at least two of them"}
_REASON: Cell = {"missing": "the same by definition, or not measured"}


def difference_table(differences: Rows) -> Table:
    """Return a table of differences ``FIRST_minus_SECOND``.

    Cells are marked where the interval excludes zero and the first is better.
    """
    return _transposed_table(
        differences, {name: _difference_label(name) for name in differences}, _first_is_better
    )


def sensitivity_table(sensitivity: Rows, labels: Mapping[str, str]) -> Table:
    """Return a table of true minus wrong pairs; marked where the metric separates them.

    Parameters
    ----------
    sensitivity : ``{mean, low, high, sensitive}`` by comparison and metric
    labels : of the comparisons
    """
    return _transposed_table(sensitivity, labels, lambda cell, _: bool(cell.get("sensitive")))


def insensitive_metrics(cells: Mapping[str, Cell]) -> list[str]:
    """Return the labels of the metrics that do not separate true pairs from wrong ones.

    Without an interval it is not known.
    """
    return [
        METRICS[name].label
        for name in LABELLED
        if name in cells and has_interval(cells[name]) and not cells[name]["sensitive"]
    ]


def undecided_metrics(cells: Mapping[str, Cell]) -> list[str]:
    """Return the labels of the metrics that have no interval."""
    return [
        METRICS[name].label for name in LABELLED if name in cells and not has_interval(cells[name])
    ]


def _transposed_table(
    columns: Rows, labels: Mapping[str, str], marked: Callable[[Cell, str], bool]
) -> Table:
    """Return a table with a column for each comparison and a line for each known metric."""
    selected = [name for name in LABELLED if any(name in cells for cells in columns.values())]
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


AUGMENTATION_TITLE = "Does augmentation improve PaCMO?"
AUGMENTATION_HEADS = (
    Metric("With variations", UNKNOWN, "", ""),
    Metric("Without", UNKNOWN, "", ""),
    Metric("Difference, over people", UNKNOWN, "", "interval over pairs of people, or recordings"),
    Metric("Difference, over folds", UNKNOWN, "", "interval over people and trainings"),
    Metric("Better in", UNKNOWN, "", "folds"),
)
BETTER, WORSE, OPEN = "better", "worse", "open"


def augmentation_table(pooled: Mapping[str, Any]) -> Table:
    """Return a table with a line for each metric.

    Marked: the metric is better with variations, and its interval over folds excludes zero.

    Parameters
    ----------
    pooled : ``with``, ``without``, ``clips``, ``folds``: cells by metric; ``each``: the
        differences of the folds by metric
    """
    lines = []
    for name in _known_metrics(pooled):
        metric = METRICS[name]
        label = " ".join(filter(None, (metric.label, metric.better, metric.unit)))
        mark = "best" if metric_verdict(name, pooled["folds"].get(name, {})) == BETTER else ""
        entries = (
            *(make_entry(pooled[part].get(name, {}), "") for part in ("with", "without", "clips")),
            make_entry(pooled["folds"].get(name, _ONE_FOLD), mark),
            _count_improved(name, pooled["each"][name]),
        )
        lines.append(Line(label, metric.meaning, is_model=False, entries=entries))
    return Table(AUGMENTATION_HEADS, tuple(lines))


def augmentation_verdict(pooled: Mapping[str, Any]) -> str:
    """Return a sentence that states whether augmentation improves the metrics."""
    result: dict[str, list[str]] = {BETTER: [], WORSE: [], OPEN: []}
    for name in _known_metrics(pooled):
        if METRICS[name].better in (LOWER, HIGHER):
            result[metric_verdict(name, pooled["folds"].get(name, {}))].append(METRICS[name].label)
    if result[BETTER] and result[WORSE]:
        head = "Augmentation improves some metrics and worsens others"
    elif result[BETTER]:
        head = "Augmentation improves the metrics"
    elif result[WORSE]:
        head = "Augmentation worsens the metrics"
    else:
        head = "No significant effect of augmentation"
    parts = [
        f"significantly {verdict} in {', '.join(result[verdict])}"
        for verdict in (BETTER, WORSE)
        if result[verdict]
    ]
    parts.append(f"undecided in {len(result[OPEN])} of {sum(map(len, result.values()))} metrics")
    return f"{head}; {'; '.join(parts)}."


def metric_verdict(name: str, cell: Cell) -> str:
    """Return whether the interval of a difference shows better, worse, or neither (open)."""
    low, high = finite_value(cell, "low"), finite_value(cell, "high")
    sign = {LOWER: -1, HIGHER: 1}.get(METRICS[name].better, 0)
    if low is None or high is None or not sign or low <= 0 <= high:
        return OPEN
    return BETTER if sign * low > 0 else WORSE


def _known_metrics(pooled: Mapping[str, Any]) -> list[str]:
    return [name for name in LABELLED if name in pooled["each"]]


def _count_improved(name: str, differences: Sequence[float]) -> Entry:
    sign = {LOWER: -1, HIGHER: 1}.get(METRICS[name].better, 0)
    if not sign:
        return Entry(_NO_VALUE, "", "", "this metric has no better direction")
    improved = sum(sign * value > 0 for value in differences)
    return Entry(f"{improved} of {len(differences)}", "", "", "")
