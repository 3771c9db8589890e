"""The page of decisions: what was measured from night to night, and what was decided."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from markupsafe import Markup

from pacmo_core.figures.columns import METRICS
from pacmo_core.figures.curves import Curve, charts
from pacmo_core.figures.viewer import environment, part


@dataclass(frozen=True)
class Row:
    """One decision as shown."""

    number: int
    at: str
    experiment: str
    verdict: str
    reasons: tuple[str, ...]
    model: str
    shelf: int


def render_history(curve: Curve | None, rows: Sequence[Row]) -> str:
    """Render the page; it needs no network."""
    page = environment().get_template("history.html")
    drawn = charts(replace(curve, terms=_labelled(curve.terms))) if curve else []
    return page.render(charts=drawn, rows=rows, style=Markup(part("report.css")))


def _labelled(terms: Mapping[str, Sequence[float]]) -> dict[str, Sequence[float]]:
    labels = {name: metric.label for name, metric in METRICS.items()}
    labels["f2id_floor"] = "F²ID, floor"
    return {labels.get(name, name): values for name, values in terms.items()}
