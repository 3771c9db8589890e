"""The page of decisions: what was measured from night to night, and what was decided."""

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files

from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

from pacmo_core.figures.columns import METRICS
from pacmo_core.figures.curves import Curve, charts


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
    here = files("pacmo_core.figures")
    text, style = ((here / name).read_text("utf-8") for name in ("history.html", "report.css"))
    page = Environment(autoescape=True, undefined=StrictUndefined).from_string(text)
    drawn = charts(curve) if curve else []
    labels = {name: metric.label for name, metric in METRICS.items()}
    labels["f2id_floor"] = "F²ID, floor"
    return page.render(charts=drawn, labels=labels, rows=rows, style=Markup(style))
