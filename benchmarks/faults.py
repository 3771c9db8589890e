"""Kill a run at random moments; the next one must end right, with an undisturbed one's bytes.

Usage: python -m benchmarks.faults --kills N [--seed S] [--experiment NAME] [--json] [STAGE ...]

A run is ``python -m flows.run reproduce STAGE ...`` in a clone of the last commit. For each kill it
starts with no output, and after a random share of an undisturbed run's time one process is
killed -9: the supervisor, the Prefect server, the flow, DVC or a stage, or all. Then it is run again.
As many clones as the machine has processors are killed side by side; each kill has its own seed.
``recovered``: how many of these ended well. ``identical``: after how many every file under data,
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

PRODUCTS = ("data", "models", "reports")
MADE = (*PRODUCTS, "dvc.lock", ".dvc/cache", ".dvc/tmp", "history", "checkpoints", "live")
STAGES = ("train_gru",)
LIMIT_S = 900.0


def begin(folder: Path, stages: list[str]) -> "subprocess.Popen[bytes]":
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
    """Take away all that runs have made."""
    for name in MADE:
        path = folder / name
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)


def hashes(folder: Path) -> dict[str, str]:
    """Hash every file that a run makes."""
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for product in PRODUCTS
        for path in sorted((folder / product).rglob("*"))
        if path.is_file() and path.name != ".gitignore"
    }


def descendants(pid: int) -> list[int]:
    """List a process and all below it, as they are now."""
    parents = {}
    for status in Path("/proc").glob("[0-9]*/stat"):
        try:
            parents[int(status.parent.name)] = int(status.read_text().rpartition(")")[2].split()[1])
        except OSError:
            continue  # gone meanwhile
    found = [pid]
    for process in found:
        found += [child for child, parent in parents.items() if parent == process]
    return found


def kill_one(process: "subprocess.Popen[bytes]", choice: random.Random) -> None:
    """Kill a random one of a run's processes, or all, and wait until the flow has ended."""
    below = descendants(process.pid)
    victims = below if choice.random() < 0.25 else [choice.choice(below)]
    for pid in victims:
        try:
            os.kill(pid, signal.SIGKILL)
        except ProcessLookupError:
            continue  # it ended by itself
    process.wait(timeout=LIMIT_S)


@dataclass(frozen=True)
class Undisturbed:
    """What a run without a kill takes and leaves."""

    seconds: float
    bytes_of: dict[str, str]


def undisturbed(folder: Path, stages: list[str]) -> Undisturbed:
    """Run once in peace.

    Raises
    ------
    RuntimeError
        If even that fails, with the end of what it said.
    """
    clear(folder)
    start = time.perf_counter()
    if begin(folder, stages).wait(timeout=LIMIT_S):
        raise RuntimeError((folder / "flow.log").read_text()[-2000:])
    return Undisturbed(time.perf_counter() - start, hashes(folder))


def kill_and_recover(
    folder: Path, stages: list[str], wanted: Undisturbed, choice: random.Random
) -> tuple[bool, bool]:
    """Kill a run at a random moment, and run again; tell whether it ended well, and as wanted."""
    clear(folder)
    process = begin(folder, stages)
    time.sleep(choice.uniform(0, wanted.seconds))
    kill_one(process, choice)
    well = begin(folder, stages).wait(timeout=LIMIT_S) == 0
    same = hashes(folder) == wanted.bytes_of
    if not (well and same):
        print((folder / "flow.log").read_text()[-3000:], file=sys.stderr)
    return well, same


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
        wanted = undisturbed(folders.get(), options.stages)
        folders.put(Path(place) / "0")

        def disturb(number: int) -> tuple[bool, bool]:
            folder = folders.get()
            choice = random.Random(f"{options.seed}:{number}")
            well, same = kill_and_recover(folder, options.stages, wanted, choice)
            print(f"kill {number}: ended well {well}, identical {same}", file=sys.stderr)
            folders.put(folder)
            return well, same

        found = list(pool.map(disturb, range(1, options.kills + 1)))
    recovered, identical = (sum(column) for column in zip(*found, strict=True))
    figures = {"kills": options.kills, "undisturbed_s": wanted.seconds}
    show({**figures, "recovered": recovered, "identical": identical}, as_json=options.json)


if __name__ == "__main__":
    main()
