"""Tables of paired differences, a line a metric: who is better, what sees the partner."""

from collections.abc import Callable, Mapping

from pacmo_core.figures.columns import HIGHER, LOWER, METRICS, ROWS, UNKNOWN, Metric
from pacmo_core.figures.tables import Cell, Line, Rows, Table, entry_of, number_in

BETWEEN = "_minus_"
_REASON: Cell = {"missing": "the same by definition, or not measured"}


def difference_table(differences: Rows) -> Table:
    """Lay out differences ``FIRST_minus_SECOND``; marked where the first is better for certain.

    An interval that reaches zero marks nothing, nor does a metric without a better direction.
    """
    return _turned(differences, {name: _label(name) for name in differences}, _first_is_better)


def sight_table(sensitivity: Rows, labels: Mapping[str, str]) -> Table:
    """Lay out true pairs less wrong ones; marked where the metric tells them apart.

    Parameters
    ----------
    sensitivity : comparison to metric to ``{mean, low, high, sees}``
    labels : what each comparison is called
    """
    return _turned(sensitivity, labels, lambda cell, _: bool(cell.get("sees")))


def blind(cells: Mapping[str, Cell]) -> list[str]:
    """Name the metrics of one comparison that do not tell true pairs from wrong ones."""
    return [METRICS[name].label for name in METRICS if name in cells and not cells[name]["sees"]]


def _turned(columns: Rows, labels: Mapping[str, str], marked: Callable[[Cell, str], bool]) -> Table:
    """Make a column of each comparison and a line of each metric that the page knows."""
    shown = [name for name in METRICS if any(name in cells for cells in columns.values())]
    lines = []
    for name in shown:
        cells = [column.get(name, _REASON) for column in columns.values()]
        entries = tuple(entry_of(cell, "best" if marked(cell, name) else "") for cell in cells)
        metric = METRICS[name]
        label = " ".join(filter(None, (metric.label, metric.better, metric.unit)))
        lines.append(Line(label, "", is_model=False, entries=entries))
    heads = tuple(Metric(labels.get(name, name), UNKNOWN, "", "") for name in columns)
    return Table(heads, tuple(lines))


def _label(name: str) -> str:
    first, _, second = name.partition(BETWEEN)
    return " − ".join(ROWS.get(row, (row, ""))[0] for row in (first, second))


def _first_is_better(cell: Cell, name: str) -> bool:
    low, high = number_in(cell, "low"), number_in(cell, "high")
    if low is None or high is None:
        return False
    return {LOWER: high < 0, HIGHER: low > 0}.get(METRICS[name].better, False)
