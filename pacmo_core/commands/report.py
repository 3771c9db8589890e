"""``pacmo report``: the report of a run with the history of runs and decisions."""

import hashlib
import json
import subprocess
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer
from ruamel.yaml import YAML

from pacmo_core.commands.study_store import GENERATED, REAL
from pacmo_core.figures.history import (
    COMPARED_METRICS,
    Measurement,
    ReportContext,
    StageRun,
    StudyTable,
    add_history,
)
from pacmo_core.figures.numbers import format_estimate, format_number
from pacmo_core.project.lock import writer_lock
from pacmo_core.project.promote import history_rows
from pacmo_core.project.records import utc_now
from pacmo_core.project.workspace import (
    DECISIONS,
    DETAILS,
    MEASUREMENTS,
    REPORT,
    REPORT_WITH_HISTORY,
    STUDY,
    CommandError,
    enter_project,
    errors_in_one_line,
)
from pacmo_core.project.workspace import LOCK as WRITER_LOCK
from pacmo_core.promotion import read_decisions
from pacmo_core.store.files import write_text

MODEL = "pacmo"
EDITED = ", edited"
_NO_COMMIT = "unknown"


def record_measurement(metrics: Path, history: Path) -> list[Measurement]:
    """Add a run to the history unless its metrics are there already; return the history.

    An incomplete line of the history is an error: nothing is dropped silently.
    """
    runs = read_measured(history)
    content = metrics.read_bytes()
    digest = hashlib.sha256(content).hexdigest()
    if all(run.digest != digest for run in runs):
        runs.append(_measurement(json.loads(content), digest, len(runs) + 1))
        write_text(history, "".join(json.dumps(asdict(run)) + "\n" for run in runs))
    return runs


def read_measured(history: Path) -> list[Measurement]:
    """Read the history; empty before the first run."""
    if not history.exists():
        return []
    lines = history.read_text(encoding="utf-8").splitlines()
    return [Measurement(**json.loads(line)) for line in lines]


def _measurement(details: dict[str, Any], digest: str, number: int) -> Measurement:
    row = details["pacmo"]["rows"].get(MODEL, {})
    metrics = {name: row[name] for name in COMPARED_METRICS if name in row}
    return Measurement(number, utc_now(), details["experiment"], commit(), digest, metrics)


def commit() -> str:
    """Return the commit of the code, marked if the code was edited since."""
    words = ["git", "describe", "--always", f"--dirty={EDITED}", "--exclude=*", "--abbrev=12"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    return done.stdout.strip() if done.returncode == 0 else _NO_COMMIT


LOCK = Path("dvc.lock")
# Rahman et al. (2022), table 3.
PAPER_STUDY = {"real": ("0.81", "0.75"), "made_up": ("0.19", "0.25")}
VERDICT_LABELS = {"real": "judged real", "made_up": "judged generated"}


def write_report_with_history(out: Path = REPORT_WITH_HISTORY) -> Path:
    """Write the report of the run with the history.

    Raises
    ------
    CommandError
        If there is no report of a run.
    """
    for path in (REPORT, DETAILS):
        if not path.exists():
            raise CommandError(f"no {path}: run ./run first")
    runs = record_measurement(DETAILS, MEASUREMENTS)
    context = ReportContext(
        study=study_table(json.loads(STUDY.read_text(encoding="utf-8")))
        if STUDY.exists()
        else None,
        runs=tuple(runs),
        decisions=tuple(history_rows(read_decisions(DECISIONS)[0])),
        commands=_commands(runs),
        stages=tuple(stages_run(LOCK)) if LOCK.exists() else (),
    )
    write_text(out, add_history(REPORT.read_text(encoding="utf-8"), context))
    return out


def study_table(result: dict[str, Any]) -> StudyTable:
    """Return the result of ``pacmo study report`` beside table 3 of the paper."""
    lines = tuple(
        (
            VERDICT_LABELS[text],
            *(_format_share(result[kind][text]) for kind in (REAL, GENERATED)),
            *PAPER_STUDY[text],
        )
        for text in VERDICT_LABELS
    )
    return StudyTable(lines, tuple(_notes(result)))


def _notes(result: dict[str, Any]) -> Iterator[str]:
    mixed = result["mixed"]
    yield f"{result['people']} people; Wilson score intervals, which take answers as independent."
    yield (
        f"Logistic model with random intercepts of people (standard deviation "
        f"{format_number(mixed['person_spread'])}) and clips "
        f"({format_number(mixed['clip_spread'])}): captured clips are judged real more often by "
        f"{format_estimate({'mean': mixed['difference'], **mixed})} logits."
    )
    of, digest = Path(result["of"]["reactions"]), result["of"]["reactions_sha256"]
    same = of.exists() and hashlib.sha256(of.read_bytes()).hexdigest() == digest
    origin = "those of this run" if same else "those of another run"
    yield f"The judged reactions are {origin} ({of.as_posix()}, SHA-256 {digest[:16]})."


def _format_share(share: dict[str, Any]) -> str:
    return f"{format_estimate(share)}, {share['count']:,} of {share['of']:,}"


def _commands(runs: list[Measurement]) -> tuple[str, ...]:
    digest = hashlib.sha256(DETAILS.read_bytes()).hexdigest()
    run = next(run for run in runs if run.digest == digest)
    mark = "    # and the edits since then" if run.commit.endswith(EDITED) else ""
    return (
        f"git checkout {run.commit.removesuffix(EDITED)}{mark}",
        f"./run repro {run.experiment}",
    )


def stages_run(lock: Path) -> Iterator[StageRun]:
    """Yield the command of every stage in dvc.lock, and the hashes of its inputs and outputs."""
    stages = YAML(typ="safe").load(lock)["stages"]
    for name, stage in stages.items():
        read, wrote = (
            tuple((file["path"], str(file.get("md5", ""))) for file in stage.get(kind, ()))
            for kind in ("deps", "outs")
        )
        yield StageRun(name, stage["cmd"].strip(), read, wrote)


Out = Annotated[Path, typer.Option(help="the HTML file to write")]


def report(out: Out = REPORT_WITH_HISTORY) -> None:
    """Write the report of the run with the history, the study and every command.

    reports/report.html describes its run alone. This page adds the measurements of earlier runs
    (each call adds the present run to the history), the decisions of the nightly runs,
    history/study.json if there is one, and all stages of dvc.lock.
    """
    out = out if out == REPORT_WITH_HISTORY else Path.cwd() / out
    enter_project()
    with errors_in_one_line(), writer_lock("report", WRITER_LOCK):
        typer.echo(f"{write_report_with_history(out)}")
