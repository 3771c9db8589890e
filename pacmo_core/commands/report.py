"""A line a run of what it measured, so that runs can be compared when their files are gone."""

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
    errors_in_one_line,
)
from pacmo_core.promotion import read_decisions
from pacmo_core.store.files import write_text

MODEL = "pacmo"
EDITED = ", edited"
_NO_COMMIT = "unknown"


def record_measurement(metrics: Path, history: Path) -> list[Measurement]:
    """Add a run to the history unless its metrics stand there already; give the history.

    A line of the history that a fault has cut short is an error: nothing is dropped in silence.
    """
    runs = read_measured(history)
    content = metrics.read_bytes()
    digest = hashlib.sha256(content).hexdigest()
    if all(run.digest != digest for run in runs):
        runs.append(_measurement(json.loads(content), digest, len(runs) + 1))
        write_text(history, "".join(json.dumps(asdict(run)) + "\n" for run in runs))
    return runs


def read_measured(history: Path) -> list[Measurement]:
    """Read the history; there is none before the first run."""
    if not history.exists():
        return []
    lines = history.read_text(encoding="utf-8").splitlines()
    return [Measurement(**json.loads(line)) for line in lines]


def _measurement(facts: dict[str, Any], digest: str, number: int) -> Measurement:
    result = facts["pacmo"]["rows"].get(MODEL, {})
    metrics = {name: result[name] for name in COMPARED_METRICS if name in result}
    return Measurement(number, utc_now(), facts["experiment"], commit(), digest, metrics)


def commit() -> str:
    """Name the commit of the code, and say if it was edited since."""
    words = ["git", "describe", "--always", f"--dirty={EDITED}", "--exclude=*", "--abbrev=12"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    return done.stdout.strip() if done.returncode == 0 else _NO_COMMIT


LOCK = Path("dvc.lock")
# Rahman et al. (2022), table 3.
PAPER_STUDY = {"real": ("0.81", "0.75"), "made_up": ("0.19", "0.25")}
VERDICT_LABELS = {"real": "taken for real", "made_up": "taken for made up"}


def write_report_with_history(out: Path = REPORT_WITH_HISTORY) -> Path:
    """Write the page.

    Raises
    ------
    CommandError
        If there is no run's page.
    """
    for path in (REPORT, DETAILS):
        if not path.exists():
            raise CommandError(f"no {path}: reproduce first")
    runs = record_measurement(DETAILS, MEASUREMENTS)
    beside = ReportContext(
        study=study_table(json.loads(STUDY.read_text(encoding="utf-8")))
        if STUDY.exists()
        else None,
        runs=tuple(runs),
        decisions=tuple(history_rows(read_decisions(DECISIONS)[0])),
        commands=_commands(runs),
        stages=tuple(stages_run(LOCK)) if LOCK.exists() else (),
    )
    write_text(out, add_history(REPORT.read_text(encoding="utf-8"), beside))
    return out


def study_table(found: dict[str, Any]) -> StudyTable:
    """Lay out what ``pacmo study report`` counted beside the paper's table 3."""
    lines = tuple(
        (
            VERDICT_LABELS[text],
            *(_format_share(found[kind][text]) for kind in (REAL, GENERATED)),
            *PAPER_STUDY[text],
        )
        for text in VERDICT_LABELS
    )
    return StudyTable(lines, tuple(_notes(found)))


def _notes(found: dict[str, Any]) -> Iterator[str]:
    mixed = found["mixed"]
    yield f"{found['people']} people; intervals by Wilson's score, answers taken for independent."
    yield (
        f"With a leaning of every person (spread {mixed['person_spread']:.2f}) and every clip "
        f"({mixed['clip_spread']:.2f}), captured clips are taken for real more often by "
        f"{mixed['difference']:.2f} logits ({mixed['low']:.2f} to {mixed['high']:.2f})."
    )
    of, digest = Path(found["of"]["reactions"]), found["of"]["reactions_sha256"]
    same = of.exists() and hashlib.sha256(of.read_bytes()).hexdigest() == digest
    selected = "those of this run" if same else "not those that stand here now: another run's"
    yield f"The reactions judged are {selected} ({of.as_posix()}, SHA-256 {digest[:16]})."


def _format_share(found: dict[str, Any]) -> str:
    low, high = found["low"], found["high"]
    return f"{found['mean']:.2f} ({low:.2f} … {high:.2f}), {found['count']} of {found['of']}"


def _commands(runs: list[Measurement]) -> tuple[str, ...]:
    digest = hashlib.sha256(DETAILS.read_bytes()).hexdigest()
    run = next(run for run in runs if run.digest == digest)
    mark = "    # and what was edited since" if run.commit.endswith(EDITED) else ""
    return (
        f"git checkout {run.commit.removesuffix(EDITED)}{mark}",
        f"./run repro {run.experiment}",
    )


def stages_run(lock: Path) -> Iterator[StageRun]:
    """Read from DVC's lock how every stage was run, and the hashes of what it read and wrote."""
    stages = YAML(typ="safe").load(lock)["stages"]
    for name, facts in stages.items():
        read, wrote = (
            tuple((result["path"], str(result.get("md5", ""))) for result in facts.get(kind, ()))
            for kind in ("deps", "outs")
        )
        yield StageRun(name, facts["cmd"].strip(), read, wrote)


Out = Annotated[Path, typer.Option(help="the page")]


def report(out: Out = REPORT_WITH_HISTORY) -> None:
    """Write the run's page with the history of runs and decisions, the study, every command.

    reports/report.html rests on its run alone. This page is the same and holds beside it what
    other runs measured (each time this is called, the run that stands here is remembered), the
    decisions of the nights, history/study.json if there is one, and dvc.lock in full.
    """
    with errors_in_one_line():
        typer.echo(f"{write_report_with_history(out)}")
