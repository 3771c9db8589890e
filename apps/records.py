"""A record of every run: a JSON file each, from its begin, so that a killed run is known as one.

Runs are numbered and ordered by their numbers: a clock may jump.
"""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from pacmo_core.store.files import write_text

RUNNING, DONE, HELD, FAILED, KILLED, SKIPPED = (
    *("running", "done", "held", "failed", "killed", "skipped"),
)
EXIT_CODES = {DONE: 0, SKIPPED: 0, FAILED: 1, HELD: 3}
BUSY_CODE = 4


@dataclass
class Run:
    """One run.

    Parameters
    ----------
    number : from 1, rising
    job : nightly, reproduce, retrain, prune, rollback, intake
    started, ended : UTC, ISO 8601; ended is empty while it runs
    outcome : running, done, held, failed, killed or skipped
    reason : in words, where it was not just done
    facts : what it did, in JSON's terms
    """

    number: int
    job: str
    started: str
    ended: str = ""
    outcome: str = RUNNING
    reason: str = ""
    facts: dict[str, Any] = field(default_factory=dict)


def now() -> str:
    """Give the time as the records write it."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def read_runs(folder: Path) -> list[Run]:
    """Read the records by number; one that cannot be read says so in its reason."""
    return [_read(path) for path in sorted(folder.glob("[0-9]*.json"))]


@contextmanager
def recorded(job: str, folder: Path) -> Iterator[Run]:
    """Record a run; one that raises is ``failed`` with the error's line, and still raises.

    The caller holds the writers' lock: a record that says ``running`` is then a killed run's.
    """
    runs = read_runs(folder)
    for run in runs:
        if run.outcome == RUNNING:
            run.outcome, run.reason = KILLED, "the process ended before the run did"
            _write(folder, run)
    run = Run(max((r.number for r in runs), default=0) + 1, job, now())
    _write(folder, run)
    try:
        yield run
    except BaseException as fault:
        run.outcome, run.reason = FAILED, " ".join(f"{type(fault).__name__}: {fault}".split())
        raise
    finally:
        run.ended = now()
        if run.outcome == RUNNING:
            run.outcome = DONE
        _write(folder, run)


def _read(path: Path) -> Run:
    try:
        return Run(**json.loads(path.read_text(encoding="utf-8")))
    except (ValueError, TypeError) as fault:
        return Run(int(path.stem), "unknown", "", "", FAILED, f"{path} cannot be read: {fault}")


def _write(folder: Path, run: Run) -> None:
    text = json.dumps(asdict(run), indent=2, allow_nan=False) + "\n"
    write_text(folder / f"{run.number:06d}.json", text)
