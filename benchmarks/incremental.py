"""Cost of one more capture relative to a clean run, and of a flow with nothing to do.

Usage: python -m benchmarks.incremental [--captures N] [--json] [PART ...]

``one_more_share``: with N captures in, the seconds that one more costs in ``ingest``, ``cut``,
``split`` and ``augment`` (four variations a clip, a quarter of the experiment's plan: of all of it
the share is smaller, and a clean run takes half an hour), relative to their clean run; both run the
commands of the stages. ``same_bytes``: whether the files are then those of a clean run of all
captures, for a tenth of the captures.

``flow_noop_extra_s``: additional time of ``python -m flows.run reproduce`` over ``dvc repro`` if
nothing is stale. ``dask_speedup``: two Dask
workers beside one process, on variations (wants the extra ``dask``). ``..._processor_...``: the
same in processor seconds, which others' load on the machine does not change.
"""

import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from ruamel.yaml import YAML

from benchmarks._figures import arguments, show
from benchmarks._spread import spread
from benchmarks.faults import hashes
from benchmarks.pipeline import PATH, call, clone, plain_commands, processor_seconds

MEASURED = ("ingest", "cut", "split", "augment")
N_ACTIONS, REPLICATIONS = 10, 2
REPEATS = 3
MIN_CAPTURES = 40  # fewer may leave no clip to test on


def set_captures(folder: Path, n_captures: int) -> Path:
    """Make N captures and one more, which is set aside; return the path of the latter."""
    path, yaml = folder / "params.yaml", YAML()
    params = yaml.load(path)
    pairs = -(-(n_captures + 1) // (N_ACTIONS * REPLICATIONS))
    params["synthesise"] |= {"n_pairs": pairs, "replications": REPLICATIONS}
    params["augment"]["clips"]["max_clips"] = None
    params["augment"]["plan"] |= {"profiles": [], "n_random": 0}
    params["augment"]["plan"]["single"]["scales"] = []
    yaml.dump(params, path)
    call(folder, sys.executable, "-m", "stages.synthesise", "data/raw")
    files = sorted((folder / "data/raw").rglob("*.skeleton"))
    for file in files[n_captures + 1 :]:
        file.unlink()
    away = folder / files[n_captures // 2].name
    shutil.move(files[n_captures // 2], away)
    return away


def run_measured(folder: Path) -> dict[str, float]:
    """Run the commands of the measured stages; return the seconds of each."""
    commands = {c.split()[2].removeprefix("stages."): c for c in plain_commands(folder)}
    return {name: call(folder, "sh", "-c", commands[name]) for name in MEASURED}


def one_more(folder: Path, n_captures: int) -> dict[str, float]:
    """Run from nothing, then with one more capture."""
    away = set_captures(folder, n_captures)
    start = processor_seconds()
    clean = run_measured(folder)
    shutil.move(away, folder / "data/raw" / away.name)
    middle = processor_seconds()
    more = run_measured(folder)
    figures = {
        "one_more_share": sum(more.values()) / sum(clean.values()),
        "one_more_processor_share": (processor_seconds() - middle) / (middle - start),
    }
    for name in MEASURED:
        figures |= {f"{name}_clean_s": clean[name], f"{name}_one_more_s": more[name]}
    return figures


def same_bytes(folder: Path, n_captures: int) -> dict[str, float]:
    """Compare the files after one more capture with those of a clean run."""
    one_more(folder, n_captures)
    expected = hashes(folder)
    shutil.rmtree(folder / "checkpoints")
    for path in sorted((folder / "data").iterdir()):
        if path.name != "raw":
            shutil.rmtree(path)
    run_measured(folder)
    return {"same_bytes": float(hashes(folder) == expected)}


def cost(folder: Path, command: list[str], **environment: str) -> tuple[float, float]:
    """Return the median wall time and processor time of a command."""
    settings = {k: v for k, v in os.environ.items() if k != "PREFECT_API_URL"}
    settings |= {"PATH": PATH, "PYTHONPATH": str(folder), **environment}
    times, worked = [], []
    for _ in range(REPEATS):
        start, before = time.perf_counter(), processor_seconds()
        subprocess.run(command, cwd=folder, env=settings, check=True, capture_output=True)
        times.append(time.perf_counter() - start)
        worked.append(processor_seconds() - before)
    return statistics.median(times), statistics.median(worked)


def noop(folder: Path) -> dict[str, float]:
    """Measure the cost of a flow if nothing is stale."""
    dvc = [sys.executable, "-m", "dvc", "repro", "split@1"]
    flow = [sys.executable, "-m", "flows.run", "reproduce", "split"]
    call(folder, *dvc)
    (plain, plain_work), (flow_s, work) = cost(folder, dvc), cost(folder, flow)
    return {
        "noop_dvc_s": plain,
        "flow_noop_extra_s": flow_s - plain,
        "flow_noop_extra_processor_s": work - plain_work,
    }


def parts(place: Path, n_captures: int) -> dict[str, Callable[[], dict[str, float]]]:
    """Return the measurements by name, quick ones first."""
    few = max(n_captures // 10, MIN_CAPTURES)
    return {
        "noop": lambda: noop(clone(place / "noop", "smallest")),
        "dask": spread,
        "bytes": lambda: same_bytes(clone(place / "few", "smallest"), few),
        "one_more": lambda: one_more(clone(place / "many", "smallest"), n_captures),
    }


def main() -> None:
    """Measure and print."""
    parser = arguments(__doc__ or "")
    parser.add_argument("--captures", type=int, default=1000)
    parser.add_argument("parts", nargs="*", help="noop, dask, bytes, one_more; none: all")
    options = parser.parse_args()
    figures: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as place:
        for name, measure in parts(Path(place), options.captures).items():
            if not options.parts or name in options.parts:
                figures |= measure()
                print(f"{name} measured: {figures}", file=sys.stderr, flush=True)
    show(figures, as_json=options.json)


if __name__ == "__main__":
    main()
