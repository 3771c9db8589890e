"""Run DVC within a time limit, and leave no process behind."""

import os
import re
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

from pacmo_core.project.lock import writer_environment
from pacmo_core.project.stages import has_remote
from pacmo_core.project.workspace import (
    LOCK,
    STAGE_LOGS,
    STAGE_PROGRESS,
    CommandError,
    log_event,
)
from stages.common.progress import PROGRESS

# Outcomes of dvc repro.
RAN, RESTORED, UP_TO_DATE = "done", "restored", "up to date"
PUSH_ATTEMPTS, FIRST_WAIT_S = 3, 5.0
_N_LAST_LINES = 2
_SUMMARY = re.compile(r"ERROR: failed to reproduce '.*': failed to run: ")


class StageError(CommandError):
    """A stage that failed or exceeded its time limit, with the end of its output."""


def reproduce_stage(stage: str, *, force: bool, limit_s: float) -> str:
    """Run ``dvc repro`` for one stage.

    Parameters
    ----------
    stage : its address
    force : run it even if nothing that it depends on has changed
    limit_s : seconds

    Returns
    -------
    ``done`` if its command ran, ``restored`` if DVC took the outputs from its cache,
    ``up to date`` if nothing had changed
    """
    options = ["--force"] if force else []
    output = run_dvc(stage, ["repro", "--single-item", *options, stage], limit_s)
    if "Running stage" in output:
        return RAN
    return RESTORED if "is cached" in output else UP_TO_DATE


def run_dvc(name: str, words: list[str], limit_s: float) -> str:
    """Run ``dvc WORDS`` and return its output, which also goes to ``history/stages/NAME.log``.

    It runs in a process group of its own, which is killed at the end: the process of a stage
    outlives a DVC that is killed, and could write while the next run does.

    Parameters
    ----------
    name : of the log, and of the file of progress
    words : arguments of ``dvc``
    limit_s : seconds, by a clock that is not adjusted

    Raises
    ------
    StageError
        If it fails or takes longer.
    """
    # Stages overlap: DVC releases its lock while the command of a stage runs; others wait for it.
    command = [sys.executable, "-m", "dvc", "--wait-for-lock", *words]
    log, progress = STAGE_LOGS / f"{name}.log", progress_file(name)
    for folder in (log.parent, progress.parent):
        folder.mkdir(parents=True, exist_ok=True)
    progress.unlink(missing_ok=True)
    with log.open("wb") as output:
        process = subprocess.Popen(
            command,
            stdout=output,
            stderr=output,
            start_new_session=True,
            env=_environment(progress),
        )
        try:
            code = process.wait(timeout=limit_s)
        except subprocess.TimeoutExpired:
            raise StageError(f"{name}: stopped after its limit of {limit_s:.0f} s") from None
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            progress.unlink(missing_ok=True)
    text = log.read_text(encoding="utf-8", errors="replace")
    if code:
        raise StageError(f"{name}: dvc exited with {code}: {_last_lines(text)}")
    return text


def push(limit_s: float) -> bool:
    """Push outputs and the run cache to DVC's remote, in up to three attempts.

    The only step that uses a network, and so the only one that is repeated.

    Returns
    -------
    whether there is a remote
    """
    if not has_remote():
        return False
    for attempt in range(1, PUSH_ATTEMPTS + 1):
        try:
            run_dvc("push", ["push", "--run-cache"], limit_s)
        except StageError as error:
            if attempt == PUSH_ATTEMPTS:
                raise
            log_event("push failed and is repeated", attempt=attempt, reason=str(error))
            time.sleep(FIRST_WAIT_S * 3 ** (attempt - 1))
        else:
            return True
    return True


def progress_file(stage: str) -> Path:
    """Return the file to which a stage writes its progress."""
    return STAGE_PROGRESS / f"{stage}.json"


def _environment(progress: Path) -> dict[str, str]:
    # First on the path, so that "python" in the command of a stage is this environment's.
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', '')}"
    return {
        **os.environ,
        **writer_environment(LOCK),
        PROGRESS: str(progress.resolve()),
        "PATH": path,
    }


def _last_lines(text: str) -> str:
    # Without DVC's echo of the command and its own summary of a stage that has said why.
    lines = [line.strip() for line in text.splitlines()]
    shown = [s for s in lines if s and not s.startswith(">") and not _SUMMARY.match(s)]
    return " / ".join(shown[-_N_LAST_LINES:])
