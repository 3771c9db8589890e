"""Let DVC do something, within a time limit, and leave no process behind."""

import os
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

from pacmo_core.project.lock import writer_environment
from pacmo_core.project.workspace import LOCK, STAGE_LOGS, CommandError

_LAST_LINES = 2


class StageError(CommandError):
    """A stage that failed or took too long, with the end of what it said."""


def run_dvc(name: str, words: list[str], limit_s: float) -> str:
    """Run ``dvc WORDS``; what it says goes to ``history/stages/NAME.log`` and is returned.

    It runs in a process group of its own, which is ended with it: a stage whose DVC was killed
    lives on otherwise, and may write while the next run does.

    Parameters
    ----------
    name : of the log
    words : after ``dvc``
    limit_s : seconds, by a clock that does not jump

    Raises
    ------
    StageError
        If it fails or takes longer.
    """
    # Stages overlap: DVC lets go of its lock while a stage's command runs, and the rest waits.
    command = [sys.executable, "-m", "dvc", "--wait-for-lock", *words]
    log = STAGE_LOGS / f"{name}.log"
    log.parent.mkdir(parents=True, exist_ok=True)
    bin_folder = str(Path(sys.executable).parent)
    path = f"{bin_folder}{os.pathsep}{os.environ.get('PATH', '')}"
    environment = {**os.environ, **writer_environment(LOCK), "PATH": path}
    with log.open("wb") as out:
        process = subprocess.Popen(
            command, stdout=out, stderr=out, start_new_session=True, env=environment
        )
        try:
            code = process.wait(timeout=limit_s)
        except subprocess.TimeoutExpired:
            raise StageError(f"{name}: stopped after its limit of {limit_s:.0f} s") from None
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
    text = log.read_text(encoding="utf-8", errors="replace")
    if code:
        raise StageError(f"{name}: dvc ended with {code}: {_end_of(text)}")
    return text


def _end_of(text: str) -> str:
    # DVC's echo of the command and its own summary say nothing new.
    lines = [line.strip() for line in text.splitlines()]
    told = [line for line in lines if line and not line.startswith((">", "ERROR: failed to repro"))]
    return " / ".join(told[-_LAST_LINES:])
