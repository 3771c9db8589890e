"""The page of decisions: what was measured from night to night, and what was decided."""

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files

from jinja2 import Environment, StrictUndefined, Template
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
    part = _part(curve, rows)
    return _template("history.html").render(part=part, style=Markup(_text("report.css")))


def insert_history(report: str, curve: Curve | None, rows: Sequence[Row]) -> str:
    """Put the same into a report, as its last section.

    A report is made before what is decided about it, so that it cannot hold the decision itself.
    """
    link = '<a href="#history">History</a>\n  </nav>'
    section = f'<section id="history">\n<h2>History</h2>\n{_part(curve, rows)}</section>\n'
    before, end, after = report.partition("</main>")
    return before.replace("</nav>", link, 1) + section + end + after


def _part(curve: Curve | None, rows: Sequence[Row]) -> Markup:
    drawn = charts(curve) if curve else []
    labels = {name: metric.label for name, metric in METRICS.items()}
    labels["f2id_floor"] = "F²ID, floor"
    return Markup(_template("history_part.html").render(charts=drawn, labels=labels, rows=rows))


def _template(name: str) -> Template:
    return Environment(autoescape=True, undefined=StrictUndefined).from_string(_text(name))


def _text(name: str) -> str:
    return (files("pacmo_core.figures") / name).read_text("utf-8")
