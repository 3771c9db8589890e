"""The report: one self-contained page with the tables, curves and clips of a run."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

from markupsafe import Markup

from pacmo_core.figures.clips import PlayedClip
from pacmo_core.figures.curves import Curve, charts
from pacmo_core.figures.tables import Rows, Table, metrics_table
from pacmo_core.figures.viewer import (
    packed_scenes,
    player_scripts,
    read_asset,
    script_hash,
    template_environment,
)

SECTIONS = {
    "pacmo": "Reactions, generated from the partner alone",
    "pacmo_partner": "Do reactions answer their partner?",
    "pacmo_same_action": "The same within one act",
    "pacmo_further": "Feet, bodies, variety",
    "augment": "Variations: the same interaction on other bodies",
    "skeleton_prior": "Skeleton priors: retargeting and generation",
}

CONTACT = 0.1  # metres; for the eye alone, metrics have a setting of their own


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
    contact : metres between joints of two people that touch
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
    contact: float = CONTACT
    gallery: tuple[PlayedClip, ...] = ()


def render_report(report: Report) -> str:
    """Write the report as one HTML document that refers to nothing outside itself.

    Equal reports give equal bytes. Every text is escaped; the page's own policy lets no script
    run but the player's, by their hashes.
    """
    scripts = player_scripts() if report.clips else ()
    return (
        template_environment()
        .get_template("report.html")
        .render(
            report=report,
            reasons=Counter(row.reason for row in report.data.quarantined).most_common(),
            tables=_tables(report.tables),
            curves={name: charts(curve) for name, curve in report.curves.items()},
            packed=[
                packed_scenes(clip.scenes(), contact=report.contact)
                for clip in (*report.clips, *report.gallery)
            ],
            style=Markup(read_asset("player.css") + read_asset("report.css")),
            scripts=[Markup(script) for script in scripts],
            hashes=[script_hash(script) for script in scripts],
        )
    )


def _tables(tables: Mapping[str, Rows]) -> list[tuple[str, Table]]:
    return [(SECTIONS.get(name, name), metrics_table(rows)) for name, rows in tables.items()]
