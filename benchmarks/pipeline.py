"""Time of the embedded default in a new clone, and of a run with nothing to do.

Usage: python -m benchmarks.pipeline [--experiment NAME] [--json]

``cold_s``: ``dvc repro`` in a clone with an empty cache; ``noop_s``: again. The peer in the same
run is the same commands called one after the other without DVC, on the smallest experiment:
``times_plain`` is the ratio, the overhead of DVC.
"""

import ctypes
import os
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path

from dvc.repo import Repo

from benchmarks._figures import arguments, show
from pacmo_core.project.stages import upstream_stages

ROOT = Path(__file__).parents[1]
SUBREAPER = 36  # PR_SET_CHILD_SUBREAPER
_WAIT_S = 2.0
PATH = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])


def call(folder: Path, *command: str) -> float:
    """Run a command in a clone; return the seconds that it took."""
    environment = {**os.environ, "PATH": PATH, "PYTHONPATH": str(folder)}
    start = time.perf_counter()
    subprocess.run(command, cwd=folder, env=environment, check=True, stdout=sys.stderr)
    return time.perf_counter() - start


def processor_seconds() -> float:
    """Return the processor seconds of all commands that have ended, and of all that they started.

    Processes that outlive their parents for a moment, as a fork server does, are included: they
    become children of this one, which waits for them.
    """
    ctypes.CDLL(None).prctl(SUBREAPER, 1, 0, 0, 0)
    deadline = time.monotonic() + _WAIT_S
    with suppress(ChildProcessError):  # none is left
        while time.monotonic() < deadline:
            if os.waitpid(-1, os.WNOHANG) == (0, 0):
                time.sleep(0.02)
    times = os.times()
    return times.children_user + times.children_system


def clone(folder: Path, experiment: str) -> Path:
    """Clone the project's last commit and set an experiment."""
    subprocess.run(["git", "clone", "-q", str(ROOT), str(folder)], check=True)
    call(folder, sys.executable, "-m", "pacmo_core.commands.cli", "use", experiment)
    return folder


def plain_commands(folder: Path) -> list[str]:
    """List the stages' commands in running order."""
    here = Path.cwd()
    os.chdir(folder)
    try:
        order = upstream_stages([])
        with Repo() as repo:
            commands = {stage.addressing: stage.cmd for stage in repo.index.stages}
        return [commands[name] for name in order]
    finally:
        os.chdir(here)


def main() -> None:
    """Measure and print."""
    parser = arguments(__doc__ or "")
    parser.add_argument("--experiment", default="default")
    options = parser.parse_args()
    dvc = (sys.executable, "-m", "dvc", "repro")
    with tempfile.TemporaryDirectory() as place:
        whole = clone(Path(place) / "whole", options.experiment)
        cold, noop = call(whole, *dvc), call(whole, *dvc)
        small = clone(Path(place) / "small", "smallest")
        small_dvc = call(small, *dvc)
        plain = clone(Path(place) / "plain", "smallest")
        small_plain = sum(call(plain, "sh", "-c", command) for command in plain_commands(plain))
    figures = {"cold_s": cold, "noop_s": noop, "times_plain": small_dvc / small_plain}
    show(figures, as_json=options.json)


if __name__ == "__main__":
    main()
