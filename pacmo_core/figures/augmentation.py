"""Whether variations help: one model trained with and without them, metric by metric."""

from collections.abc import Mapping, Sequence
from typing import Any

from pacmo_core.figures.columns import HIGHER, LOWER, METRICS, UNKNOWN, Metric
from pacmo_core.figures.tables import Cell, Line, Table, entry_of, number_in

TITLE = "Does augmentation pay?"
HEADS = (
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
    for name in _known(pooled):
        metric = METRICS[name]
        label = " ".join(filter(None, (metric.label, metric.better, metric.unit)))
        mark = "best" if verdict(name, pooled["folds"].get(name, {})) == BETTER else ""
        entries = (
            *(entry_of(pooled[part].get(name, {}), "") for part in ("with", "without", "clips")),
            entry_of(pooled["folds"].get(name, {}), mark),
            entry_of(_count(name, pooled["each"][name]), ""),
        )
        lines.append(Line(label, metric.meaning, is_model=False, entries=entries))
    return Table(HEADS, tuple(lines))


def answer(pooled: Mapping[str, Any]) -> str:
    """Say in a sentence whether it pays, whichever way that is."""
    found: dict[str, list[str]] = {BETTER: [], WORSE: [], OPEN: []}
    for name in _known(pooled):
        if METRICS[name].better in (LOWER, HIGHER):
            found[verdict(name, pooled["folds"].get(name, {}))].append(METRICS[name].label)
    if found[BETTER] and found[WORSE]:
        head = "It pays in some metrics and costs in others"
    elif found[BETTER]:
        head = "It pays"
    elif found[WORSE]:
        head = "It does not pay: it costs"
    else:
        head = "It is not shown to pay, nor to cost"
    said = [
        f"{what} for certain in {', '.join(found[what])}" for what in (BETTER, WORSE) if found[what]
    ]
    said.append(f"undecided in {len(found[OPEN])} of {sum(map(len, found.values()))} metrics")
    return f"{head}; {'; '.join(said)}."


def verdict(name: str, cell: Cell) -> str:
    """Say which way a difference is clear of zero: better, worse, or open."""
    low, high = number_in(cell, "low"), number_in(cell, "high")
    sign = {LOWER: -1, HIGHER: 1}.get(METRICS[name].better, 0)
    if low is None or high is None or not sign or low <= 0 <= high:
        return OPEN
    return BETTER if sign * low > 0 else WORSE


def _known(pooled: Mapping[str, Any]) -> list[str]:
    return [name for name in METRICS if name in pooled["each"]]


def _count(name: str, differences: Sequence[float]) -> Cell:
    sign = {LOWER: -1, HIGHER: 1}.get(METRICS[name].better, 0)
    if not sign:
        return {"missing": "which way is better, a difference does not tell"}
    return {"mean": float(sum(sign * value > 0 for value in differences))}
