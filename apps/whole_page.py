"""The run's page with what is known beside it: the study, other runs, decisions, every command."""

import hashlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML

from apps.measured import EDITED, remember
from pacmo_core.figures.whole import Beside, Measured, StageRun, StudyTable, make_whole
from pacmo_core.project.promote import history_rows
from pacmo_core.project.workspace import (
    DECISIONS,
    MEASUREMENTS,
    METRICS,
    REPORT,
    REPORT_WITH_HISTORY,
    STUDY,
    CommandError,
)
from pacmo_core.promotion import read_decisions
from pacmo_core.store.files import write_text
from pacmo_core.store.study import GENERATED, REAL

LOCK = Path("dvc.lock")
# Rahman et al. (2022), table 3.
PAPER = {"real": ("0.81", "0.75"), "made_up": ("0.19", "0.25")}
NAMES = {"real": "taken for real", "made_up": "taken for made up"}


def write_whole(out: Path = REPORT_WITH_HISTORY) -> Path:
    """Write the page.

    Raises
    ------
    CommandError
        If there is no run's page.
    """
    for path in (REPORT, METRICS):
        if not path.exists():
            raise CommandError(f"no {path}: reproduce first")
    runs = remember(METRICS, MEASUREMENTS)
    beside = Beside(
        study=study_table(json.loads(STUDY.read_text(encoding="utf-8")))
        if STUDY.exists()
        else None,
        runs=tuple(runs),
        decisions=tuple(history_rows(read_decisions(DECISIONS)[0])),
        commands=_commands(runs),
        stages=tuple(stages_run(LOCK)) if LOCK.exists() else (),
    )
    write_text(out, make_whole(REPORT.read_text(encoding="utf-8"), beside))
    return out


def study_table(found: dict[str, Any]) -> StudyTable:
    """Lay out what ``pacmo study report`` counted beside the paper's table 3."""
    lines = tuple(
        (NAMES[said], *(_share(found[kind][said]) for kind in (REAL, GENERATED)), *PAPER[said])
        for said in NAMES
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
    shown = "those of this run" if same else "not those that stand here now: another run's"
    yield f"The reactions judged are {shown} ({of.as_posix()}, SHA-256 {digest[:16]})."


def _share(found: dict[str, Any]) -> str:
    low, high = found["low"], found["high"]
    return f"{found['mean']:.2f} ({low:.2f} … {high:.2f}), {found['count']} of {found['of']}"


def _commands(runs: list[Measured]) -> tuple[str, ...]:
    digest = hashlib.sha256(METRICS.read_bytes()).hexdigest()
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
            tuple((found["path"], str(found.get("md5", ""))) for found in facts.get(kind, ()))
            for kind in ("deps", "outs")
        )
        yield StageRun(name, facts["cmd"].strip(), read, wrote)
