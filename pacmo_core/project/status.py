"""Status of a project: last runs, current model, stale stages, inbox, quarantine, disk."""

import json
import shutil
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from textwrap import shorten
from typing import Any

from pacmo_core import promotion
from pacmo_core.data.limits import printable, walk_files
from pacmo_core.project.lock import lock_holder
from pacmo_core.project.records import DONE, REJECTED, SKIPPED, RunRecord, as_killed, read_runs
from pacmo_core.project.stages import read_status
from pacmo_core.project.workspace import (
    DECISIONS,
    DVC_CACHE,
    INBOX,
    INTAKE_PLAN,
    LOCK,
    PROMOTED_MODELS,
    QUARANTINE,
    REASON_FILE,
    RUNS,
)
from pacmo_core.promotion import Decision, read_decisions
from pacmo_core.store.files import StoreError
from pacmo_core.store.tables import QuarantineRecord, read_rows

UNUSABLE = Path("data/sequences/quarantine.parquet")

_N_LATEST = 5  # of runs and decisions
_MAX_LINES = 20  # of each list
_MAX_CHARACTERS = 90  # of a reason why a stage is stale; JSON has all of it


def project_status(*, stale: bool) -> dict[str, Any]:
    """Gather the status as JSON values.

    Parameters
    ----------
    stale : include the stale stages
    """
    decisions, unreadable = read_decisions(DECISIONS)
    disk, holder = shutil.disk_usage(Path.cwd()), lock_holder(LOCK)
    runs = read_runs(RUNS)[-_N_LATEST:]
    return {
        "writing": holder,
        "runs": [asdict(run) for run in (runs if holder else as_killed(runs))],
        "current": promotion.current_model(PROMOTED_MODELS),
        "decisions": [asdict(decision) for decision in decisions[-_N_LATEST:]],
        "broken_decisions": [error.file.as_posix() for error in unreadable],
        "stale": stale_reasons(holder) if stale else {},
        "inbox": [
            printable(file.relative_to(INBOX).as_posix()) for file in sorted(walk_files(INBOX))
        ],
        "unfinished_intake": INTAKE_PLAN.exists(),
        "unusable": _unusable_captures(),
        "quarantine": quarantined_captures(),
        "free_gb": round(disk.free / 1e9, 1),
        "cache_gb": round(sum(file.stat().st_size for file in walk_files(DVC_CACHE)) / 1e9, 2),
    }


def last_run_failed(status: dict[str, Any]) -> bool:
    """Return whether the last run failed or was killed, and none runs now."""
    outcome = status["runs"][-1]["outcome"] if status["runs"] else DONE
    return outcome not in (DONE, REJECTED, SKIPPED) and not status["writing"]


def stale_reasons(holder: str) -> dict[str, list[str]]:
    """Return the reasons by stale stage; unknown while a run holds the lock."""
    if holder:
        return {"unknown": ["a run is writing; known after its end"]}
    return read_status().reasons


def quarantined_captures() -> list[dict[str, Any]]:
    """List the captures that were moved from the inbox to quarantine, with the reason."""
    captures = []
    for file in sorted(QUARANTINE.glob(f"*/{REASON_FILE}")):
        try:
            facts = dict(json.loads(file.read_text(encoding="utf-8")))
            name, reason = printable(str(facts["name"])), printable(str(facts["reason"]))
        except (ValueError, TypeError, KeyError) as error:
            name, reason, facts = file.parent.name, f"{file} cannot be read: {error}", {}
        captures.append({"folder": file.parent.as_posix(), **facts, "name": name, "reason": reason})
    return captures


def _unusable_captures() -> str:
    """Say how many captures the last ingestion could not use; empty if none."""
    try:
        count = len(read_rows(UNUSABLE, QuarantineRecord)) if UNUSABLE.exists() else 0
    except (StoreError, OSError) as error:
        return f"unknown: {error}"
    return f"{count} captures, which pacmo quarantine lists" if count else ""


def status_lines(status: dict[str, Any]) -> Iterable[str]:
    """Yield the status as lines of text."""
    yield f"writing now   {_holder_text(status['writing'])}"
    yield f"current       {status['current'] or 'none'}"
    yield f"disk          {status['free_gb']} GB free; DVC's cache {status['cache_gb']} GB"
    yield from _block("runs", [_run_line(RunRecord(**run)) for run in status["runs"]])
    decisions = [_decision_line(Decision(**facts)) for facts in status["decisions"]]
    yield from _block("decisions", decisions)
    yield from _block("stale", [_stale_line(*item) for item in status["stale"].items()])
    yield from _block("inbox", status["inbox"])
    captures = [f"{capture['name']}: {capture['reason']}" for capture in status["quarantine"]]
    yield from _block("quarantine", captures)
    if status["unusable"]:
        yield f"unusable      {status['unusable']}"
    if status["unfinished_intake"]:
        yield "a run was killed while it moved captures from the inbox; the next run continues"
    for file in status["broken_decisions"]:
        yield f"unreadable: {file}"


def _holder_text(holder: str) -> str:
    if not holder.startswith("{"):
        return holder or "no run"
    facts = json.loads(holder)
    return f"{facts['job']} since {facts['since']}, process {facts['pid']}"


def _block(name: str, lines: list[str]) -> Iterable[str]:
    yield f"{name:13} {len(lines) or 'none'}"
    yield from (f"  {line}" for line in lines[:_MAX_LINES])


def _stale_line(stage: str, reasons: list[str]) -> str:
    return f"{stage}: {'; '.join(shorten(reason, _MAX_CHARACTERS) for reason in reasons)}"


def _run_line(run: RunRecord) -> str:
    return f"{run.number} {run.started} {run.job}: {run.outcome}  {run.reason}".rstrip()


def _decision_line(decision: Decision) -> str:
    return f"{decision.number} {decision.at} {decision.verdict}  {'; '.join(decision.reasons)}"
