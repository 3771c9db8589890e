"""Tables of paired differences: which of two rows a metric prefers, and what it cannot see."""

from collections.abc import Mapping, Sequence

from pacmo_core.figures.columns import HIGHER, LOWER, METRICS, ROWS
from pacmo_core.figures.tables import Cell, Line, Rows, Table, entry_of, number_in

BETWEEN = "_minus_"


def difference_table(differences: Rows, columns: Sequence[str]) -> Table:
    """Lay out differences ``FIRST_minus_SECOND``; marked where the first is better for certain.

    An interval that reaches zero marks nothing, nor does a metric without a better direction.
    """
    shown = [c for c in columns if any(c in cells for cells in differences.values())]
    lines = tuple(
        Line(
            _label(name),
            "",
            is_model=True,
            entries=tuple(entry_of(cells.get(c, {}), _mark(cells.get(c, {}), c)) for c in shown),
        )
        for name, cells in differences.items()
    )
    return Table(tuple(METRICS[column] for column in shown), lines)


def sight_table(sensitivity: Mapping[str, Mapping[str, Cell]], labels: Mapping[str, str]) -> Table:
    """Lay out true pairs less wrong ones; marked where the metric tells them apart.

    Parameters
    ----------
    sensitivity : comparison to metric to ``{mean, low, high, sees}``
    labels : what each comparison is called
    """
    shown = [m for m in METRICS if any(m in cells for cells in sensitivity.values())]
    lines = tuple(
        Line(
            labels.get(name, name),
            "",
            is_model=True,
            entries=tuple(
                entry_of(cells.get(m, {}), "best" if cells.get(m, {}).get("sees") else "")
                for m in shown
            ),
        )
        for name, cells in sensitivity.items()
    )
    return Table(tuple(METRICS[metric] for metric in shown), lines)


def blind(cells: Mapping[str, Cell]) -> list[str]:
    """Name the metrics of one comparison that do not tell true pairs from wrong ones."""
    return [METRICS[name].label for name in METRICS if name in cells and not cells[name]["sees"]]


def _label(name: str) -> str:
    first, _, second = name.partition(BETWEEN)
    return " − ".join(ROWS.get(row, (row, ""))[0] for row in (first, second))


def _mark(cell: Cell, column: str) -> str:
    low, high = number_in(cell, "low"), number_in(cell, "high")
    if low is None or high is None:
        return ""
    better = {LOWER: high < 0, HIGHER: low > 0}.get(METRICS[column].better, False)
    return "best" if better else ""
