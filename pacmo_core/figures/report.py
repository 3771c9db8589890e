"""The report: one self-contained page with the tables, curves and clips of a run."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

from markupsafe import Markup

from pacmo_core.figures.curves import Curve, charts
from pacmo_core.figures.findings import Finding
from pacmo_core.figures.tables import Rows, Table, metrics_table
from pacmo_core.figures.viewer import (
    PlayedClip,
    packed_scenes,
    player_scripts,
    read_asset,
    script_hash,
    template_environment,
)

SECTIONS = {
    "pacmo": "Reactions, generated from the motion of the partner",
    "pacmo_partner": "Do reactions depend on their partner?",
    "pacmo_same_action": "The same, with partners permuted within an action",
    "pacmo_contact": "Do they meet?",
    "pacmo_contact_by_action": "Contacts met, by action",
    "pacmo_plausibility": "Plausibility",
    "pacmo_further": "Further metrics",
    "augment": "Variations: the same interaction on other bodies",
    "skeleton_prior": "Skeleton priors: retargeting and generation",
}

STYLES = ("player.css", "table.css", "report.css")
CONTACT = 0.1  # metres; for display only, metrics have their own setting


@dataclass(frozen=True)
class Section:
    """A further table with its notes."""

    title: str
    table: Table
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class QuarantineRow:
    """A raw file in quarantine, with the reason."""

    file: str
    line: int | None
    reason: str


@dataclass(frozen=True)
class DataSummary:
    """The dataset of a run.

    Parameters
    ----------
    files_read : number of raw files
    clips : number of clips cut from them
    quarantined : files that could not be used
    facts : by name: people, actions, duration, frames, fps, skeleton
    split : by name: method, clips in each split, dropped clips
    """

    files_read: int
    clips: int
    quarantined: tuple[QuarantineRow, ...] = ()
    facts: Mapping[str, str] = field(default_factory=dict)
    split: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Report:
    """The contents of the report.

    Parameters
    ----------
    title : name of the experiment
    summary : what the page is about, in one sentence
    facts : commands and hashes of the run, by name
    data : the dataset
    tables : section to rows to metrics to ``{mean, low, high}``, or ``{missing: reason}``
    notes : footnotes of the tables, such as the noise floor and the extractor
    sections : further tables with their notes
    curves : training curves by name
    clips : clips to play
    contact : distance in metres below which joints of two people are marked as in contact
    gallery : clips with their variations, to play
    generated : clips with the motions of skeleton priors, to play
    findings : what was found, a sentence for each model: the page opens with them
    findings_note : what the sentences rest on
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
    generated: tuple[PlayedClip, ...] = ()
    findings: tuple[Finding, ...] = ()
    findings_note: str = ""

    @property
    def played(self) -> tuple[PlayedClip, ...]:
        """All clips, in the order of the page."""
        return (*self.clips, *self.gallery, *self.generated)


def render_report(report: Report) -> str:
    """Return the report as one self-contained HTML document.

    Equal reports give equal bytes. Every text is escaped; the content security policy of the page
    allows only the scripts of the player, by their hashes.
    """
    scripts = player_scripts() if report.played else ()
    return (
        template_environment()
        .get_template("report.html")
        .render(
            report=report,
            reasons=Counter(row.reason for row in report.data.quarantined).most_common(),
            tables=_tables(report.tables),
            curves={name: charts(curve) for name, curve in report.curves.items()},
            packed=[packed_scenes(clip.scenes(), contact=report.contact) for clip in report.played],
            style=Markup("".join(map(read_asset, STYLES))),
            scripts=[Markup(script) for script in scripts],
            hashes=[script_hash(script) for script in scripts],
        )
    )


def _tables(tables: Mapping[str, Rows]) -> list[tuple[str, Table]]:
    return [(SECTIONS.get(name, name), metrics_table(rows)) for name, rows in tables.items()]
