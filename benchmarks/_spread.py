"""Variations of synthetic clips by one process and by two Dask workers, alternately.

Usage: python -m benchmarks._spread    # one process: its seconds, and the hash of its results
"""

import hashlib
import importlib
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from importlib.util import find_spec

import numpy as np

from benchmarks._retargeting_tasks import SETTINGS
from pacmo_core.augmentation.run import (
    Batch,
    BatchResult,
    scene_from,
    solve_batch,
    solve_on_cluster,
    solver_key,
    source_key,
)
from pacmo_core.synthesis import ACTIONS, sample_interaction, sample_scripts

PAIRS = 4  # of people, one clip per action each
SCALES = (0.9, 1.1)  # of person a
WORKERS = 2
REPEATS = 3
# Dask's profiler takes 5 % of two cores.
QUIET = {"distributed.worker.profile.enabled": False}


def batches() -> Iterator[Batch]:
    """Yield a batch of bodies for each clip."""
    for script, random in sample_scripts(
        0, population=0, pairs=PAIRS, actions=tuple(ACTIONS), replications=1
    ):
        source = sample_interaction(script, random)
        n_bones = scene_from(source).n_bones
        scales = np.stack([np.repeat([scale, 1.0], n_bones) for scale in SCALES])
        names = tuple(map(str, SCALES))
        yield Batch(source_key(source), solver_key(SETTINGS), source, SETTINGS, scales, names)


def timed(do: Callable[[list[Batch]], Iterable[BatchResult]]) -> tuple[float, str]:
    """Return the seconds that the batches take, and the hash of their variations."""
    first, *rest = batches()
    list(do([first, *rest[:WORKERS]]))  # imports, and each worker's first use of the libraries
    start = time.perf_counter()
    outcomes = list(do(rest))
    seconds = time.perf_counter() - start
    digest = hashlib.sha256()
    for outcome in sorted(outcomes, key=lambda outcome: outcome.source_key):
        digest.update(f"{outcome.source_key} {outcome.error}".encode())
        for name, variation in sorted(outcome.variations.items()):
            digest.update(f"{name} {variation.measurements}".encode() + variation.motions.tobytes())
    return seconds, digest.hexdigest()


def spread() -> dict[str, float]:
    """Compare two Dask workers with one process; empty if Dask is not installed."""
    if find_spec("distributed") is None:
        print("dask_speedup needs the extra dask, which is not installed", file=sys.stderr)
        return {}
    distributed, dask = map(importlib.import_module, ("distributed", "dask"))
    ratios, digests = [], set()
    dask.config.set(QUIET)
    with distributed.LocalCluster(
        n_workers=WORKERS, threads_per_worker=1, dashboard_address=None, processes=True
    ) as cluster:
        address = cluster.scheduler_address
        for _ in range(REPEATS):
            alone, digest = _alone()
            together, other = timed(lambda some: solve_on_cluster(some, address))
            ratios.append(alone / together)
            digests |= {digest, other}
    speedup = statistics.median(ratios)
    return {"dask_speedup": speedup, "dask_same_bytes": float(len(digests) == 1)}


def _alone() -> tuple[float, str]:
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks._spread"], check=True, capture_output=True, text=True
    )
    seconds, digest = done.stdout.split()
    return float(seconds), digest


if __name__ == "__main__":
    print(*timed(lambda some: map(solve_batch, some)))
