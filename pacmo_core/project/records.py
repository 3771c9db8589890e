"""Records of runs: a JSON file each, written at the start of a run and again at its end.

A record that says ``running`` while no run holds the writer lock is that of a killed run. Runs are
ordered by number, as the clock may be set back.
"""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from pacmo_core.data.limits import printable
from pacmo_core.project.workspace import EXIT_FAILED, EXIT_REJECTED
from pacmo_core.store.files import write_text

RUNNING, DONE, REJECTED, FAILED, KILLED, SKIPPED = (
    *("running", "done", "rejected", "failed", "killed", "skipped"),
)
EXIT_CODES = {DONE: 0, SKIPPED: 0, FAILED: EXIT_FAILED, REJECTED: EXIT_REJECTED}
INTERRUPTED = "interrupted"
_KILLED_REASON = "the process ended before the run did"


@dataclass
class RunRecord:
    """One run.

    Parameters
    ----------
    number : from 1, increasing
    job : nightly, reproduce, retrain, prune, rollback or intake
    started, ended : UTC, ISO 8601; ended is empty while it runs
    outcome : running, done, rejected, failed, killed or skipped
    reason : of any outcome other than ``done``
    facts : what it did, JSON values
    """

    number: int
    job: str
    started: str
    ended: str = ""
    outcome: str = RUNNING
    reason: str = ""
    facts: dict[str, Any] = field(default_factory=dict)


def utc_now() -> str:
    """Return the UTC time in ISO 8601, to the second."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def read_runs(folder: Path) -> list[RunRecord]:
    """Read the records by number; an unreadable one is ``failed`` with the error as its reason."""
    return [_read(path) for path in sorted(folder.glob("[0-9]*.json"))]


@contextmanager
def record_run(job: str, folder: Path) -> Iterator[RunRecord]:
    """Record a run; one that raises is ``failed`` with the exception's line, and raises on.

    The caller holds the writer lock.
    """
    close_killed_runs(folder)
    runs = read_runs(folder)
    run = RunRecord(max((r.number for r in runs), default=0) + 1, job, utc_now())
    _write(folder, run)
    try:
        yield run
    except Exception as error:
        run.outcome = FAILED
        run.reason = printable(" ".join(f"{type(error).__name__}: {error}".split()))
        raise
    except BaseException:  # KeyboardInterrupt, or Prefect's on SIGTERM
        run.outcome, run.reason = KILLED, INTERRUPTED
        raise
    finally:
        run.ended = utc_now()
        if run.outcome == RUNNING:
            run.outcome = DONE
        _write(folder, run)


def close_killed_runs(folder: Path, reason: str = _KILLED_REASON) -> None:
    """Set records that say ``running`` to ``killed``; the caller holds the writer lock."""
    for run in read_runs(folder):
        if run.outcome == RUNNING:
            run.outcome, run.reason = KILLED, reason
            _write(folder, run)


def as_killed(runs: list[RunRecord]) -> list[RunRecord]:
    """Show running records as killed, for a reader that knows that no run holds the lock."""
    for run in runs:
        if run.outcome == RUNNING:
            run.outcome, run.reason = KILLED, _KILLED_REASON
    return runs


def _read(path: Path) -> RunRecord:
    try:
        return RunRecord(**json.loads(path.read_text(encoding="utf-8")))
    except (ValueError, TypeError) as error:
        reason = f"{path} cannot be read: {error}"
        return RunRecord(int(path.stem), "unknown", "", "", FAILED, reason)


def _write(folder: Path, run: RunRecord) -> None:
    text = json.dumps(asdict(run), indent=2, allow_nan=False) + "\n"
    write_text(folder / f"{run.number:06d}.json", text)
