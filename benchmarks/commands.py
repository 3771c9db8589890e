"""Processor time of the commands that are used most, in a workspace where nothing is stale.

Usage: ./run python -m benchmarks.commands [--json]

``help_s``, ``clips_s``, ``experiments_s``, ``status_s`` and ``noop_s``: processor seconds (user and
system, of the command and all processes that it starts) of ``pacmo --help``, ``clips``,
``experiments``, ``status`` and of ``./run``; medians of five. With
PYTHONDONTWRITEBYTECODE=1 they must be about the same.
"""

import os
import shutil
import statistics
import sys
from pathlib import Path

from benchmarks._figures import arguments, show

ROOT = Path(__file__).parents[1]
REPEATS = 5


def commands() -> dict[str, list[str]]:
    """List the commands by the figure's name; modules where the project is not installed."""
    program = shutil.which("pacmo", path=str(Path(sys.executable).parent))
    pacmo = [program] if program else [sys.executable, "-m", "pacmo_core.commands.cli"]
    installed = (ROOT / ".venv" / "stamp").exists()
    run = [str(ROOT / "run")] if installed else [sys.executable, "-m", "flows.run", "reproduce"]
    return {
        "help_s": [*pacmo, "--help"],
        "clips_s": [*pacmo, "clips"],
        "experiments_s": [*pacmo, "experiments"],
        "status_s": [*pacmo, "status"],
        "noop_s": run,
    }


def processor_seconds(command: list[str]) -> tuple[float, str]:
    """Run a command; return its processor time in seconds and its output.

    Raises
    ------
    RuntimeError
        If it fails.
    """
    read_end, write_end = os.pipe()
    pid = os.posix_spawnp(
        command[0],
        command,
        os.environ,
        file_actions=[(os.POSIX_SPAWN_DUP2, write_end, 1), (os.POSIX_SPAWN_DUP2, write_end, 2)],
    )
    os.close(write_end)
    with os.fdopen(read_end, "rb") as pipe:
        output = pipe.read().decode(errors="replace")
    _, status, usage = os.wait4(pid, 0)
    if status:
        raise RuntimeError(f"{' '.join(command)} failed: {output[-500:]}")
    return usage.ru_utime + usage.ru_stime, output


def main() -> None:
    """Measure and print."""
    options = arguments(__doc__ or "").parse_args()
    figures = {}
    for name, command in commands().items():
        output = processor_seconds(command)[1]  # once before, for caches of files
        if name == "noop_s" and "nothing is stale" not in output:
            raise RuntimeError(f"the stages are not up to date: ./run first; got {output[-500:]}")
        times = [processor_seconds(command)[0] for _ in range(REPEATS)]
        figures[name] = statistics.median(times)
    show(figures, as_json=options.json)


if __name__ == "__main__":
    main()
