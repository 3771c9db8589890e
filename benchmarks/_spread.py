"""Variations of synthetic clips by one process, or by two Dask workers.

Usage: python -m benchmarks._spread    # one process: its seconds, and the hash of what it made
"""

import hashlib
import importlib
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from importlib.util import find_spec

import numpy as np

from benchmarks._variations import SETTINGS
from pacmo_core.synthesis import ACTS, capture, write_scripts
from pacmo_core.variations.keys import maker_key, source_key
from pacmo_core.variations.solve import Lot, Outcome, scene_of, solve
from pacmo_core.variations.workers import ONE_THREAD, solve_on_cluster

PAIRS = 2  # of people, one clip an act each
SCALES = (0.9, 1.1)  # of person a
WORKERS = 2


def lots() -> Iterator[Lot]:
    """Hand out clips, each with its bodies."""
    for script, random in write_scripts(
        0, population=0, pairs=PAIRS, acts=tuple(ACTS), replications=1
    ):
        source = capture(script, random)
        n_bones = scene_of(source).n_bones
        scales = np.stack([np.repeat([scale, 1.0], n_bones) for scale in SCALES])
        names = tuple(map(str, SCALES))
        yield Lot(source_key(source), maker_key(SETTINGS), source, SETTINGS, scales, names)


def timed(do: Callable[[list[Lot]], Iterable[Outcome]]) -> tuple[float, str]:
    """Give the seconds that the lots take, and the hash of all that is made of them."""
    first, *rest = lots()
    list(do([first, *rest[:WORKERS]]))  # imports, and each worker's first use of the libraries
    start = time.perf_counter()
    outcomes = list(do(rest))
    seconds = time.perf_counter() - start
    digest = hashlib.sha256()
    for outcome in sorted(outcomes, key=lambda outcome: outcome.key):
        digest.update(f"{outcome.key} {outcome.refused}".encode())
        for name, made in sorted(outcome.made.items()):
            digest.update(f"{name} {made.figures}".encode() + made.motions.tobytes())
    return seconds, digest.hexdigest()


def spread() -> dict[str, float]:
    """Compare two Dask workers with one process; nothing where Dask is not installed."""
    if find_spec("distributed") is None:
        print("dask_speedup wants the extra dask, which is not installed", file=sys.stderr)
        return {}
    one_thread = dict.fromkeys(ONE_THREAD, "1")
    alone = subprocess.run(
        [sys.executable, "-m", "benchmarks._spread"],
        env={**os.environ, **one_thread},
        check=True,
        capture_output=True,
        text=True,
    )
    seconds, digest = alone.stdout.split()
    together, same = _on_workers()
    speedup = float(seconds) / together
    return {"dask_speedup": speedup, "dask_same_bytes": float(same == digest)}


def _on_workers() -> tuple[float, str]:
    distributed = importlib.import_module("distributed")
    with distributed.LocalCluster(
        n_workers=WORKERS, threads_per_worker=1, dashboard_address=None, processes=True
    ) as cluster:
        return timed(lambda some: solve_on_cluster(some, cluster.scheduler_address))


if __name__ == "__main__":
    print(*timed(lambda some: map(solve, some)))
