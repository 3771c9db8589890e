"""The report: one page that explains a run and plays its clips, without a network or a server."""

import base64
import hashlib
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.resources import files

from jinja2 import Environment, FunctionLoader, StrictUndefined
from markupsafe import Markup

from pacmo_core.figures.clips import PlayedClip, packed_clip
from pacmo_core.figures.curves import Curve, charts
from pacmo_core.figures.tables import Rows, Table, table

SECTIONS = {
    "pacmo": "Reactions, generated from the partner alone",
    "pacmo_partner": "Do reactions answer their partner?",
    "pacmo_same_act": "The same within one act",
    "pacmo_further": "Feet, bodies, variety",
    "augment": "Variations: the same interaction on other bodies",
    "skeleton_prior": "Skeleton priors: retargeting and generation",
}


@dataclass(frozen=True)
class Section:
    """A table that is laid out already, with notes of its own."""

    title: str
    table: Table
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class QuarantineRow:
    """A raw file that was moved out of the way, and why."""

    file: str
    line: int | None
    reason: str


@dataclass(frozen=True)
class DataSummary:
    """What was read.

    Parameters
    ----------
    files_read : raw files that were opened
    clips : clips that came of them
    quarantined : the rest
    facts : what the set is, by name: people, actions, duration, frames, fps, skeleton
    split : how it was divided, by name: method, clips per side, dropped
    """

    files_read: int
    clips: int
    quarantined: tuple[QuarantineRow, ...] = ()
    facts: Mapping[str, str] = field(default_factory=dict)
    split: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Report:
    """Everything that the page shows.

    Parameters
    ----------
    title : the experiment's name
    summary : what it is, one or two sentences
    facts : commands and hashes that made it, by name
    data : what was read
    tables : section to rows to metrics to ``{mean, low, high}``, or ``{missing: reason}``
    notes : footnotes of the tables: what the floor is, which extractor
    sections : further tables, each with notes of its own
    curves : training runs by name
    clips : clips that play
    gallery : clips and their variations, which play too
    """

    title: str
    summary: str
    facts: Mapping[str, str]
    data: DataSummary
    tables: Mapping[str, Rows]
    notes: tuple[str, ...] = ()
    sections: tuple[Section, ...] = ()
    curves: Mapping[str, Curve] = field(default_factory=dict)
    clips: tuple[PlayedClip, ...] = ()
    gallery: tuple[PlayedClip, ...] = ()


def render_report(report: Report) -> str:
    """Write the report as one HTML document that refers to nothing outside itself.

    Equal reports give equal bytes. Every text is escaped; the page's own policy lets no script
    run but the player, by its hash.
    """
    script = _part("player.js")
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    return (
        _environment()
        .get_template("report.html")
        .render(
            report=report,
            reasons=Counter(row.reason for row in report.data.quarantined).most_common(),
            tables=_tables(report.tables),
            curves={name: charts(curve) for name, curve in report.curves.items()},
            packed=[packed_clip(clip) for clip in (*report.clips, *report.gallery)],
            style=Markup(_part("report.css")),
            script=Markup(script),
            script_hash=digest,
        )
    )


def _tables(tables: Mapping[str, Rows]) -> list[tuple[str, Table]]:
    return [(SECTIONS.get(name, name), table(rows)) for name, rows in tables.items()]


def _part(name: str) -> str:
    return files("pacmo_core.figures").joinpath(name).read_text(encoding="utf-8")


def _environment() -> Environment:
    return Environment(
        loader=FunctionLoader(_part),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
