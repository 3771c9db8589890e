"""How fast and how well 967 variations of nine two-person motions are made, beside the peers.

Usage: python -m benchmarks.interaction_mesh [--json] [--cost PICTURE]

Two processes share the nine windows; times of ours include factorisation, retries and reports, not
reading. ``times_banded`` and ``times_per_frame_peer`` compare process seconds a frame: the banded
solver on one variation of a shorter window, the per-frame solver (``pip install cvxpy clarabel``)
on a few frames; both extrapolated. ``energy_gap`` is the worst of a few variations of shorter
windows against the banded solver or ours, either run to its end; where the banded one went astray,
``energy_gap_where_banded_is_lost`` is. Of figures of single variations the worst counts;
``contacts_preserved`` and ``bend_flip_fraction`` are means, with the worst beside them; ``near_error_gain`` is
the mean error of naive scaling over ours, by source.

``--cost`` instead measures 90 to 36,000 frames and 1 to 1,000 variations, and draws that.
"""

import os
import resource
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from benchmarks._cost import FRAMES, costs, draw, growth
from benchmarks._figures import arguments, show
from benchmarks._released import released_seam_ratio
from benchmarks._slower import beside_peers
from benchmarks._variations import SETTINGS, Task, tasks
from pacmo_core.interaction_mesh import Report, prepare, retarget_in_batches
from pacmo_core.interaction_mesh.scene import Array

N_PROCESSES = 2
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True)
class Done:
    """What one window came to."""

    name: str
    n_frames: int
    reports: list[Report]
    bone_error: float
    seconds: float
    peak_mb: float


def main() -> None:
    """Measure and print."""
    parser = arguments(__doc__ or "")
    parser.add_argument("--cost", type=Path, metavar="PICTURE", help="draw how the cost grows")
    options = parser.parse_args()
    kind, planned = tasks()
    if options.cost:
        show(growths(planned[-1], options.cost), as_json=options.json)
        return
    print(f"{kind} windows; {sum(len(task.scales) for task in planned)} variations", flush=True)
    start = time.perf_counter()
    # For the peers: two threads that share a core with another process wait for each other.
    os.environ |= dict.fromkeys(THREADS, "1")
    # Spawned, not forked: a process then holds its own memory alone, and has its own threads.
    with ProcessPoolExecutor(N_PROCESSES, mp_context=get_context("spawn")) as pool:
        done = list(pool.map(run, planned))
        wall = time.perf_counter() - start
        for one in done:
            print(line(one), flush=True)
        figures = speed(done, wall) | quality(done)
        peers = pool.submit(beside_peers, planned, 1 / figures["frames_per_s_per_core"])
        figures |= peers.result()
    if (released := released_seam_ratio()) is not None:
        figures["released_seam_ratio"] = released
    show(figures, as_json=options.json)


def growths(task: Task, path: Path) -> dict[str, float]:
    """Measure and draw how the cost grows."""
    measured = []
    for cost in costs(task):
        measured.append(cost)
        print(
            f"{cost.n_frames:6} frames {cost.n_variations:5} variations {cost.seconds:8.2f} s "
            f"{cost.peak_mb:6.0f} MB",
            flush=True,
        )
    draw(measured, path)
    by_frames, by_variations = measured[: len(FRAMES)], measured[len(FRAMES) :]
    return {"power_of_frames": growth(by_frames), "power_of_variations": growth(by_variations)}


def run(task: Task) -> Done:
    """Vary one window in all planned ways; motions are dropped once they are measured."""
    start = time.process_time()
    source = prepare(task.scene, SETTINGS)
    reports: list[Report] = []
    worst = spent = 0.0
    for batch in retarget_in_batches(source, task.scales):
        reports += batch.reports
        pause = time.process_time()
        worst = max(worst, bone_error(task, batch.points, task.scales[batch.rows]))
        spent += time.process_time() - pause
    seconds = time.process_time() - start - spent
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    n_frames = len(task.scene.points) * len(task.scales)
    return Done(task.name, n_frames, reports, worst, seconds, peak)


def bone_error(task: Task, points: Array, scales: Array) -> float:
    """Metres by which a bone misses its length, at worst."""
    parent, child = task.scene.bones.T
    lengths = np.linalg.norm(points[:, :, child] - points[:, :, parent], axis=-1)
    return float(
        np.abs(lengths - scales[:, None] * np.linalg.norm(task.scene.bone_vectors, axis=-1)).max()
    )


def speed(done: list[Done], wall: float) -> dict[str, float]:
    """Say how long it took, and how much memory."""
    frames = sum(one.n_frames for one in done)
    return {
        "wall_s": wall,
        "cpu_s": sum(one.seconds for one in done),
        "frames": frames,
        "frames_per_s_per_core": frames / sum(one.seconds for one in done),
        "peak_mb": max(one.peak_mb for one in done),
        "max_bone_error": max(one.bone_error for one in done),
    }


def quality(done: list[Done]) -> dict[str, float]:
    """Sum up all variations."""
    reports = [report for one in done for report in one.reports]
    gains = {one.name: near_gain(one.reports) for one in done}
    salsa = [gain for name, gain in gains.items() if "salsa" in name]
    return {
        "max_raw_residual": max(r.primal_residual for r in reports),
        "near_error_gain_min": min(gains.values()),
        "near_error_gain_salsa": min(salsa) if salsa else float("nan"),
        "contacts_preserved": float(np.mean([r.contacts_preserved for r in reports])),
        "contacts_kept_least": min(r.contacts_preserved for r in reports),
        "added_slide_cm_s": 100 * max(r.added_foot_skate for r in reports),
        "added_slide_mean_cm_s": 100 * float(np.mean([r.added_foot_skate for r in reports])),
        "penetration_max_mm": 1e3 * max(r.penetration for r in reports),
        "seam_ratio_max": max(r.acceleration_peak_ratio for r in reports),
        "bend_flip_fraction": float(np.mean([r.bend_flip_fraction for r in reports])),
        "flip_share_most": max(r.bend_flip_fraction for r in reports),
        "retried_share": float(np.mean([r.attempt > 0 for r in reports])),
        "laddered_share": float(np.mean([r.attempt > 1 for r in reports])),
    }


def near_gain(reports: list[Report]) -> float:
    """How many times naive scaling's error of near distances is ours."""
    ours, plain = (
        float(np.mean([getattr(r, name) for r in reports]))
        for name in ("near_distance_error", "near_distance_error_naive")
    )
    return plain / ours if ours else float("inf")


def line(one: Done) -> str:
    """Say how a window went."""
    slide, seam, deep = (
        max(getattr(r, name) for r in one.reports)
        for name in ("added_foot_skate", "acceleration_peak_ratio", "penetration")
    )
    kept = float(np.mean([r.contacts_preserved for r in one.reports]))
    attempts = np.bincount([r.attempt for r in one.reports])
    return (
        f"{one.name:42} {one.seconds:6.2f} s  near gain {near_gain(one.reports):5.1f}  kept "
        f"{kept:.4f}  slide {100 * slide:5.2f} cm/s  seam {seam:4.2f}  deeper {1e3 * deep:4.1f} mm"
        f"  attempts {attempts.tolist()}"
    )


if __name__ == "__main__":
    main()
