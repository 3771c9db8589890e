"""A run's page made whole: what came before and after the run, set into the page that it wrote.

A run's own page rests on the run alone, so that equal runs give equal bytes. What other runs
measured, what was decided and what people said of its clips is known elsewhere, and changes.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from pacmo_core.figures.columns import METRICS
from pacmo_core.figures.curves import Chart, Curve, charts
from pacmo_core.figures.history import Row
from pacmo_core.figures.tables import Cell, Entry, entry_of
from pacmo_core.figures.viewer import environment

# Comments of our own making: of a text with markup in it nothing stays markup.
LINKS, SECTIONS = "<!-- links -->", "<!-- sections -->"
COMPARED = ("f2id", "f2id_excess", "mmd_s", "diversity", "matching", "ape")


@dataclass(frozen=True)
class Measured:
    """What one run measured of its model.

    Parameters
    ----------
    number : from 1, in the order of the runs
    at : UTC, ISO 8601
    experiment : its name
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
        """Write the metrics that are compared."""
        return [
            entry_of(self.metrics.get(name, {"missing": "not measured"}), "") for name in COMPARED
        ]


@dataclass(frozen=True)
class StageRun:
    """A stage as it was run: its command, and the MD5 of each file that it read and wrote."""

    name: str
    command: str
    read: tuple[tuple[str, str], ...]
    wrote: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class StudyTable:
    """What people said: lines of a name and four cells, ours and the paper's of either kind."""

    lines: tuple[tuple[str, ...], ...]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Beside:
    """All that is set into the page; what is empty is left out."""

    study: StudyTable | None = None
    runs: tuple[Measured, ...] = ()
    decisions: tuple[Row, ...] = ()
    commands: tuple[str, ...] = ()
    stages: tuple[StageRun, ...] = field(default=())


def make_whole(page: str, beside: Beside) -> str:
    """Set sections into a run's page.

    Raises
    ------
    ValueError
        If the page has no one place for them.
    """
    for mark in (LINKS, SECTIONS):
        if page.count(mark) != 1:
            raise ValueError(f"wanted one {mark} in the page; got {page.count(mark)}")
    template = environment().get_template("whole.html")
    given = {
        "beside": beside,
        "columns": [METRICS[name] for name in COMPARED],
        "by_experiment": _drawn(beside.runs),
    }
    links, sections = (template.render(part=part, **given) for part in ("links", "sections"))
    return page.replace(LINKS, links).replace(SECTIONS, sections)


def _drawn(runs: Sequence[Measured]) -> dict[str, list[Chart]]:
    """Draw the metrics of each experiment that ran more than once."""
    own: dict[str, list[Measured]] = {}
    for run in runs:
        own.setdefault(run.experiment, []).append(run)
    return {name: charts(_curve(found)) for name, found in own.items() if len(found) > 1}


def _curve(runs: Sequence[Measured]) -> Curve:
    terms = {
        METRICS[name].label: [_mean(run.metrics.get(name, {})) for run in runs] for name in COMPARED
    }
    known = {name: values for name, values in terms.items() if any(v == v for v in values)}
    return Curve([float(run.number) for run in runs], known, x_label="run")


def _mean(cell: Cell) -> float:
    mean = cell.get("mean")
    return float("nan") if mean is None else float(mean)
