"""A line a run of what it measured, so that runs can be compared when their files are gone."""

import hashlib
import json
import subprocess
from dataclasses import asdict
from pathlib import Path
from typing import Any

from pacmo_core.figures.whole import COMPARED, Measured
from pacmo_core.project.records import utc_now
from pacmo_core.store.files import write_text

MODEL = "pacmo"
EDITED = ", edited"
_NO_COMMIT = "unknown"


def remember(metrics: Path, history: Path) -> list[Measured]:
    """Add a run to the history unless its metrics stand there already; give the history.

    A line of the history that a fault has cut short is an error: nothing is dropped in silence.
    """
    runs = read_measured(history)
    content = metrics.read_bytes()
    digest = hashlib.sha256(content).hexdigest()
    if all(run.digest != digest for run in runs):
        runs.append(_measured(json.loads(content), digest, len(runs) + 1))
        write_text(history, "".join(json.dumps(asdict(run)) + "\n" for run in runs))
    return runs


def read_measured(history: Path) -> list[Measured]:
    """Read the history; there is none before the first run."""
    if not history.exists():
        return []
    lines = history.read_text(encoding="utf-8").splitlines()
    return [Measured(**json.loads(line)) for line in lines]


def _measured(facts: dict[str, Any], digest: str, number: int) -> Measured:
    found = facts["pacmo"].get(MODEL, {})
    metrics = {name: found[name] for name in COMPARED if name in found}
    return Measured(number, utc_now(), facts["experiment"], commit(), digest, metrics)


def commit() -> str:
    """Name the commit of the code, and say if it was edited since."""
    words = ["git", "describe", "--always", f"--dirty={EDITED}", "--exclude=*", "--abbrev=12"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    return done.stdout.strip() if done.returncode == 0 else _NO_COMMIT
