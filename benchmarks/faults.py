"""Kill a run at random moments; the next one must succeed, with the bytes of an undisturbed one.

Usage: python -m benchmarks.faults --kills N [--seed S] [--experiment NAME] [--json] [STAGE ...]

A run is ``python -m flows.run reproduce STAGE ...`` in a clone of the last commit. For each kill it
starts with no output. After a random share of an undisturbed run's time, one process is killed -9:
the supervisor, the Prefect server, the flow, DVC, a stage, or all. Then it is run again.
``recovered``: how many of these succeeded. ``identical``: after how many every file under data,
models and reports has the undisturbed run's bytes, no file being there beside them.
"""

import hashlib
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue

from benchmarks._figures import arguments, show
from benchmarks.pipeline import clone

OUTPUT_FOLDERS = ("data", "models", "reports")
WRITTEN_BY_RUNS = (
    *OUTPUT_FOLDERS,
    "dvc.lock",
    ".dvc/cache",
    ".dvc/tmp",
    "history",
    "checkpoints",
    "live",
)
STAGES = ("train_reaction@regression-1-1",)
LIMIT_S = 900.0


def start_run(folder: Path, stages: list[str]) -> "subprocess.Popen[bytes]":
    """Start the run in a session of its own."""
    command = [sys.executable, "-m", "flows.run", "reproduce", *stages]
    environment = {k: v for k, v in os.environ.items() if k != "PREFECT_API_URL"}
    with (folder / "flow.log").open("ab") as log:
        return subprocess.Popen(
            command,
            cwd=folder,
            env={**environment, "PYTHONPATH": str(folder)},
            stdout=log,
            stderr=log,
            start_new_session=True,
        )


def clear(folder: Path) -> None:
    """Remove all that runs have written."""
    for name in WRITTEN_BY_RUNS:
        path = folder / name
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)


def hashes(folder: Path) -> dict[str, str]:
    """Hash every file that a run makes."""
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for folder_name in OUTPUT_FOLDERS
        for path in sorted((folder / folder_name).rglob("*"))
        if path.is_file() and path.name != ".gitignore"
    }


def descendants(pid: int) -> list[int]:
    """List a process and its descendants."""
    parents = {}
    for status in Path("/proc").glob("[0-9]*/stat"):
        try:
            parents[int(status.parent.name)] = int(status.read_text().rpartition(")")[2].split()[1])
        except OSError:
            continue  # it has ended
    pids = [pid]
    for process in pids:
        pids += [child for child, parent in parents.items() if parent == process]
    return pids


def kill_one(process: "subprocess.Popen[bytes]", choice: random.Random) -> None:
    """Kill a random process of a run, or all, and wait until the run has ended."""
    pids = descendants(process.pid)
    selected = pids if choice.random() < 0.25 else [choice.choice(pids)]
    for pid in selected:
        try:
            os.kill(pid, signal.SIGKILL)
        except ProcessLookupError:
            continue  # it ended by itself
    process.wait(timeout=LIMIT_S)


@dataclass(frozen=True)
class Undisturbed:
    """Duration and files of a run without a kill."""

    seconds: float
    hashes: dict[str, str]


def undisturbed(folder: Path, stages: list[str]) -> Undisturbed:
    """Run once without a kill.

    Raises
    ------
    RuntimeError
        If even that fails, with the end of its log.
    """
    clear(folder)
    start = time.perf_counter()
    if start_run(folder, stages).wait(timeout=LIMIT_S):
        raise RuntimeError((folder / "flow.log").read_text()[-2000:])
    return Undisturbed(time.perf_counter() - start, hashes(folder))


def kill_and_recover(
    folder: Path, stages: list[str], expected: Undisturbed, choice: random.Random
) -> tuple[bool, bool]:
    """Kill a run at a random moment and run again: did it succeed, did it end with equal bytes."""
    clear(folder)
    process = start_run(folder, stages)
    time.sleep(choice.uniform(0, expected.seconds))
    kill_one(process, choice)
    recovered = start_run(folder, stages).wait(timeout=LIMIT_S) == 0
    same = hashes(folder) == expected.hashes
    if not (recovered and same):
        print((folder / "flow.log").read_text()[-3000:], file=sys.stderr)
    return recovered, same


def main() -> None:
    """Kill, recover, compare and print."""
    parser = arguments(__doc__ or "")
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--experiment", default="smallest")
    parser.add_argument("--clones", type=int, default=os.cpu_count() or 1, help="side by side")
    parser.add_argument("stages", nargs="*", default=list(STAGES))
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as place, ThreadPoolExecutor(options.clones) as pool:
        folders: SimpleQueue[Path] = SimpleQueue()
        for number in range(options.clones):
            folders.put(clone(Path(place) / str(number), options.experiment))
        expected = undisturbed(folders.get(), options.stages)
        folders.put(Path(place) / "0")

        def disturb(number: int) -> tuple[bool, bool]:
            folder = folders.get()
            choice = random.Random(f"{options.seed}:{number}")
            recovered, same = kill_and_recover(folder, options.stages, expected, choice)
            print(f"kill {number}: recovered {recovered}, identical {same}", file=sys.stderr)
            folders.put(folder)
            return recovered, same

        results = list(pool.map(disturb, range(1, options.kills + 1)))
    recovered, identical = (sum(column) for column in zip(*results, strict=True))
    figures = {"kills": options.kills, "undisturbed_s": expected.seconds}
    show({**figures, "recovered": recovered, "identical": identical}, as_json=options.json)


if __name__ == "__main__":
    main()
