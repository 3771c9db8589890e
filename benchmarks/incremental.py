"""What one more capture costs beside all of them, and what a flow with nothing to do costs.

Usage: python -m benchmarks.incremental [--captures N] [--json]

``one_more_share``: with N captures in, the seconds that one more costs in ``ingest``, ``cut``,
``split`` and (where the pipeline has it) ``augment``, as a share of those stages' clean run; both
are the stages' own commands in this run, and ``same_bytes`` says whether what they then leave is
what a clean run of N + 1 leaves. ``flow_noop_extra_s``: what ``python -m flows.reproduce`` takes
more than ``dvc repro`` where nothing is stale, by hand; ``served_noop_extra_s``: with a server.
"""

import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks._figures import arguments, show
from benchmarks.faults import hashes
from benchmarks.pipeline import PATH, call, clone, plain_commands
from flows.server import a_server

MEASURED = ("ingest", "cut", "split", "augment")
ACTS, REPLICATIONS = 10, 2
REPEATS = 3
PORT = 4297


def set_captures(folder: Path, n_captures: int) -> Path:
    """Make N captures and put one away; give the one."""
    pairs = -(-(n_captures + 1) // (ACTS * REPLICATIONS))
    for path in (folder / "params.yaml", folder / "experiments" / "smallest.yaml"):
        text = path.read_text()
        path.write_text(
            text.replace("n_pairs: 4", f"n_pairs: {pairs}").replace(
                "replications: 1", f"replications: {REPLICATIONS}"
            )
        )
    call(folder, sys.executable, "-m", "stages.synthesise", "data/raw")
    files = sorted((folder / "data/raw").rglob("*.skeleton"))
    for path in files[n_captures + 1 :]:
        path.unlink()
    away = folder / files[n_captures // 2].name
    shutil.move(files[n_captures // 2], away)
    return away


def run_measured(folder: Path) -> float:
    """Run the measured stages' own commands; seconds of all."""
    wanted = [c for c in plain_commands(folder) if c.split()[2].removeprefix("stages.") in MEASURED]
    return sum(call(folder, "sh", "-c", command) for command in wanted)


def one_more(folder: Path, n_captures: int) -> dict[str, float]:
    """Run clean, then with one more, then clean with one more."""
    away = set_captures(folder, n_captures)
    clean = run_measured(folder)
    shutil.move(away, folder / "data/raw" / away.name)
    more = run_measured(folder)
    found = hashes(folder)
    shutil.rmtree(folder / "checkpoints")
    for path in sorted((folder / "data").iterdir()):
        if path.name != "raw":
            shutil.rmtree(path)
    run_measured(folder)
    share = {"clean_s": clean, "one_more_s": more, "one_more_share": more / clean}
    return {**share, "same_bytes": float(hashes(folder) == found)}


def seconds(folder: Path, command: list[str], **environment: str) -> float:
    """Give the median of a command's time."""
    settings = {k: v for k, v in os.environ.items() if k != "PREFECT_API_URL"}
    settings |= {"PATH": PATH, "PYTHONPATH": str(folder), **environment}
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        subprocess.run(command, cwd=folder, env=settings, check=True, capture_output=True)
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def noop(folder: Path) -> dict[str, float]:
    """Measure what a flow adds where nothing is stale."""
    targets = ["split"]
    dvc = [sys.executable, "-m", "dvc", "repro", "split@1"]
    flow = [sys.executable, "-m", "flows.reproduce", *targets]
    call(folder, *dvc)
    plain, by_hand = seconds(folder, dvc), seconds(folder, flow)
    os.environ["PREFECT_HOME"] = str(folder / ".prefect")
    with a_server(PORT) as address:
        served = seconds(folder, flow, PREFECT_API_URL=address)
    found = {"noop_dvc_s": plain, "flow_noop_extra_s": by_hand - plain}
    return {**found, "served_noop_extra_s": served - plain}


def main() -> None:
    """Measure and print."""
    parser = arguments(__doc__ or "")
    parser.add_argument("--captures", type=int, default=1000)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        idle = noop(clone(Path(place) / "noop", "smallest"))
        many = one_more(clone(Path(place) / "many", "smallest"), options.captures)
    show({**many, **idle}, as_json=options.json)


if __name__ == "__main__":
    main()
