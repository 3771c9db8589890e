"""The history of decisions as a page: metrics over time, and every decision with its reasons."""

from pathlib import Path

from pacmo_core.figures.curves import Curve
from pacmo_core.figures.history import Row, render_history
from pacmo_core.promotion import ROLLED_BACK, Decision
from pacmo_core.store.files import write_text


def write_page(path: Path, decisions: list[Decision]) -> None:
    """Write the page whole or not at all."""
    write_text(path, render_history(metrics_over_time(decisions), rows_of(decisions)))


def metrics_over_time(decisions: list[Decision]) -> Curve | None:
    """Draw what was measured, decision by decision; a roll-back measures nothing."""
    measured = [decision for decision in decisions if decision.verdict != ROLLED_BACK]
    if not measured:
        return None
    names = dict.fromkeys(name for decision in measured for name in decision.metrics)
    terms = {
        name: [d.metrics.get(name, {}).get("mean", float("nan")) for d in measured]
        for name in names
    }
    return Curve([float(d.number) for d in measured], terms, x_label="decision")


def rows_of(decisions: list[Decision]) -> list[Row]:
    """Lay out the decisions, the last one first."""
    return [
        Row(d.number, d.at, d.experiment, d.verdict, d.reasons, d.model[:12], d.current_model)
        for d in reversed(decisions)
    ]
