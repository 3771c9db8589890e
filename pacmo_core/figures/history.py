"""The report with decisions, earlier runs and the perceptual study; the page of the study."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from markupsafe import Markup

from pacmo_core.figures.curves import Chart, Curve, charts
from pacmo_core.figures.tables import Cell, Entry, finite_value, make_entry
from pacmo_core.figures.viewer import player_scripts, read_asset, script_hash, template_environment
from pacmo_core.metrics.catalogue import METRICS


@dataclass(frozen=True)
class DecisionRow:
    """One decision as it is displayed."""

    number: int
    at: str
    experiment: str
    verdict: str
    reasons: tuple[str, ...]
    model: str
    current_model: int


def render_history(curve: Curve | None, rows: Sequence[DecisionRow]) -> str:
    """Render the page; it needs no network."""
    page = template_environment().get_template("history.html")
    terms = charts(replace(curve, terms=_labelled_terms(curve.terms))) if curve else []
    return page.render(
        charts=terms, rows=rows, style=Markup(read_asset("table.css") + read_asset("report.css"))
    )


def _labelled_terms(terms: Mapping[str, Sequence[float]]) -> dict[str, Sequence[float]]:
    labels = {name: metric.label for name, metric in METRICS.items()}
    labels["f2id_floor"] = "F²ID, floor"
    return {labels.get(name, name): values for name, values in terms.items()}


# Unique comments: markup within texts is escaped and cannot contain them.
LINKS, SECTIONS = "<!-- links -->", "<!-- sections -->"
COMPARED_METRICS = ("f2id", "f2id_excess", "mmd_s", "diversity", "matching", "ape")


@dataclass(frozen=True)
class Measurement:
    """The metrics of the model of one run.

    Parameters
    ----------
    number : from 1, in the order of the runs
    at : UTC, ISO 8601
    experiment : name
    commit : of the code
    digest : SHA-256 of its metrics
    metrics : mean, low and high by metric
    """

    number: int
    at: str
    experiment: str
    commit: str
    digest: str
    metrics: Mapping[str, Cell]

    def entries(self) -> list[Entry]:
        """Return the compared metrics as table entries."""
        return [
            make_entry(self.metrics.get(name, {"missing": "not measured"}), "")
            for name in COMPARED_METRICS
        ]


@dataclass(frozen=True)
class StageRun:
    """A stage of a run: its command, and the MD5 hashes of its inputs and outputs."""

    name: str
    command: str
    read: tuple[tuple[str, str], ...]
    wrote: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class StudyTable:
    """Results of the study: a name and four cells a line, ours and the paper's of each kind."""

    lines: tuple[tuple[str, ...], ...]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class ReportContext:
    """All that is inserted into the report; empty parts are omitted."""

    study: StudyTable | None = None
    runs: tuple[Measurement, ...] = ()
    decisions: tuple[DecisionRow, ...] = ()
    commands: tuple[str, ...] = ()
    stages: tuple[StageRun, ...] = field(default=())


def add_history(page: str, context: ReportContext) -> str:
    """Insert the sections into the report of a run.

    Raises
    ------
    ValueError
        If the page does not have exactly one place for them.
    """
    for mark in (LINKS, SECTIONS):
        if page.count(mark) != 1:
            raise ValueError(f"wanted one {mark} in the page; got {page.count(mark)}")
    template = template_environment().get_template("whole.html")
    values = {
        "context": context,
        "columns": [METRICS[name] for name in COMPARED_METRICS],
        "by_experiment": _history_charts(context.runs),
    }
    links, sections = (template.render(part=part, **values) for part in ("links", "sections"))
    return page.replace(LINKS, links).replace(SECTIONS, sections)


def _history_charts(runs: Sequence[Measurement]) -> dict[str, list[Chart]]:
    """Return charts of the metrics of each experiment that ran more than once."""
    by_experiment: dict[str, list[Measurement]] = {}
    for run in runs:
        by_experiment.setdefault(run.experiment, []).append(run)
    return {
        name: charts(_curve(measured))
        for name, measured in by_experiment.items()
        if len(measured) > 1
    }


def _curve(runs: Sequence[Measurement]) -> Curve:
    values = {
        METRICS[name].label: {
            key: [_value_of(run.metrics.get(name, {}), key) for run in runs]
            for key in ("mean", "low", "high")
        }
        for name in COMPARED_METRICS
    }
    known = {name: ends for name, ends in values.items() if any(v == v for v in ends["mean"])}
    return Curve(
        [float(run.number) for run in runs],
        {name: ends["mean"] for name, ends in known.items()},
        x_label="run",
        intervals={name: (ends["low"], ends["high"]) for name, ends in known.items()},
    )


def _value_of(cell: Cell, key: str) -> float:
    value = finite_value(cell, key)
    return float("nan") if value is None else value


STUDY_POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; script-src {scripts}"
)


def render_study() -> tuple[str, str]:
    """Return the page and the content security policy with which a server must send it."""
    scripts = (*player_scripts(), read_asset("study.js"))
    policy = STUDY_POLICY.format(scripts=" ".join(f"'{script_hash(script)}'" for script in scripts))
    page = (
        template_environment()
        .get_template("study.html")
        .render(
            policy=policy,
            style=Markup(read_asset("player.css") + read_asset("study.css")),
            scripts=[Markup(script) for script in scripts],
        )
    )
    return page, policy
