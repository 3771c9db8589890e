"""Speed and quality of InteractionMesh on 967 variations of nine two-person motions, with peers.

Usage: python -m benchmarks.interaction_mesh [--json] [--cost PICTURE]

Two processes share the nine windows. Our times include factorisation, further attempts and
reports, but not reading. ``frames_per_s_one_variation``: the same of one variation of each window,
which bears the cost of its source alone. ``holosoma_frames_per_s``: a published retargeter on its
own motion of one person, alone on the machine (``_holosoma.py`` says how to install it; else it is
left out). ``times_banded`` and ``times_per_frame_emulation`` compare process seconds per frame: the
banded solver on one variation of a shorter window, the emulation of a per-frame solver (``pip
install cvxpy clarabel``) on a few frames, both extrapolated. ``energy_gap`` is the largest of a few
variations of shorter windows, relative to the banded solver or ours at convergence;
``energy_gap_where_banded_diverged`` that of the others. Measurements of variations are the worst;
``contacts_kept`` is a mean, with the worst in a further key; ``mb_per_frame`` is the growth of the
peak memory from the shortest to a motion of 36,000 frames;
``near_error_gain`` is the mean error of naive scaling over ours, by source.

``--cost`` instead measures 90 to 36,000 frames and 1 to 1,000 variations, and draws the cost.
"""

import os
import resource
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from benchmarks._figures import arguments, show
from benchmarks._holosoma import holosoma_figures
from benchmarks._interaction_mesh_cost import (
    FRAMES,
    draw_costs,
    growth_exponent,
    measure_cost,
    measure_costs,
    repeat_motion,
)
from benchmarks._interaction_mesh_peers import compare_with_peers, released_seam_ratio
from benchmarks._retargeting_tasks import SETTINGS, Task, retargeting_tasks
from pacmo_core.interaction_mesh import Report, prepare, retarget_in_batches
from pacmo_core.interaction_mesh.scene import Array

N_PROCESSES = 2
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True)
class WindowResult:
    """Measurements of one window."""

    name: str
    n_frames: int
    reports: list[Report]
    bone_error: float
    seconds: float
    peak_mb: float


def main() -> None:
    """Measure and print."""
    parser = arguments(__doc__ or "")
    parser.add_argument(
        "--cost", type=Path, metavar="PICTURE", help="file of the figure of the cost"
    )
    options = parser.parse_args()
    kind, planned = retargeting_tasks()
    if options.cost:
        show(cost_exponents(planned[-1], options.cost), as_json=options.json)
        return
    figures = holosoma_figures()
    print(f"{kind} windows; {sum(len(task.scales) for task in planned)} variations", flush=True)
    start = time.perf_counter()
    # For the peers: two threads on a core that another process uses wait for each other.
    os.environ |= dict.fromkeys(THREADS, "1")
    # Spawned, not forked: the peak memory of a process is then its own.
    with ProcessPoolExecutor(N_PROCESSES, mp_context=get_context("spawn")) as pool:
        done = list(pool.map(retarget_window, planned))
        wall = time.perf_counter() - start
        for one in done:
            print(summary_line(one), flush=True)
        figures |= speed(done, wall) | quality(done)
        costs = list(pool.map(measure_cost, map(one_variation, planned)))
        figures["frames_per_s_one_variation"] = sum(c.n_frames for c in costs) / sum(
            c.seconds for c in costs
        )
        figures |= memory(planned[-1])
        peers = pool.submit(compare_with_peers, planned, 1 / figures["frames_per_s_per_core"])
        figures |= peers.result()
    if (released := released_seam_ratio()) is not None:
        figures["released_seam_ratio"] = released
    show(figures, as_json=options.json)


def memory(task: Task) -> dict[str, float]:
    """Measure the peak memory of one variation of a short and of a long motion."""
    peaks = []
    for n_frames in (FRAMES[0], FRAMES[-1]):
        longer = replace(task, scene=repeat_motion(task.scene, n_frames), scales=task.scales[-1:])
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
            peaks.append(pool.submit(measure_cost, longer).result().peak_mb)
    return {
        "mb_per_frame": (peaks[1] - peaks[0]) / (FRAMES[-1] - FRAMES[0]),
        "long_peak_mb": peaks[1],
    }


def one_variation(task: Task) -> Task:
    """Return the task with one body scaled as a whole by the least scale, the second variation."""
    return replace(task, scales=task.scales[1:2])


def cost_exponents(task: Task, path: Path) -> dict[str, float]:
    """Measure and draw the cost by frames and by variations."""
    measured = []
    for cost in measure_costs(task):
        measured.append(cost)
        print(
            f"{cost.n_frames:6} frames {cost.n_variations:5} variations {cost.seconds:8.2f} s "
            f"{cost.peak_mb:6.0f} MB",
            flush=True,
        )
    draw_costs(measured, path)
    by_frames, by_variations = measured[: len(FRAMES)], measured[len(FRAMES) :]
    return {
        "exponent_of_frames": growth_exponent(by_frames),
        "exponent_of_variations": growth_exponent(by_variations),
    }


def retarget_window(task: Task) -> WindowResult:
    """Retarget one window to all planned bodies; keep measurements only."""
    start = time.process_time()
    source = prepare(task.scene, SETTINGS)
    reports: list[Report] = []
    max_error = excluded = 0.0
    for batch in retarget_in_batches(source, task.scales):
        reports += batch.reports
        pause = time.process_time()
        max_error = max(max_error, bone_error(task, batch.points, task.scales[batch.rows]))
        excluded += time.process_time() - pause
    seconds = time.process_time() - start - excluded
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    n_frames = len(task.scene.points) * len(task.scales)
    return WindowResult(task.name, n_frames, reports, max_error, seconds, peak)


def bone_error(task: Task, points: Array, scales: Array) -> float:
    """Return the largest error of a bone length in metres."""
    parent, child = task.scene.bones.T
    lengths = np.linalg.norm(points[:, :, child] - points[:, :, parent], axis=-1)
    return float(
        np.abs(lengths - scales[:, None] * np.linalg.norm(task.scene.bone_vectors, axis=-1)).max()
    )


def speed(done: list[WindowResult], wall: float) -> dict[str, float]:
    """Summarise time and memory."""
    frames = sum(one.n_frames for one in done)
    return {
        "wall_s": wall,
        "cpu_s": sum(one.seconds for one in done),
        "frames": frames,
        "frames_per_s_per_core": frames / sum(one.seconds for one in done),
        "peak_mb": max(one.peak_mb for one in done),
        "max_bone_error": max(one.bone_error for one in done),
    }


def quality(done: list[WindowResult]) -> dict[str, float]:
    """Summarise the measurements of all variations."""
    reports = [report for one in done for report in one.reports]
    gains = {one.name: near_error_gain(one.reports) for one in done}
    salsa = [gain for name, gain in gains.items() if "salsa" in name]
    return {
        "max_primal_residual": max(r.primal_residual for r in reports),
        "near_error_gain_min": min(gains.values()),
        "near_error_gain_salsa": min(salsa) if salsa else float("nan"),
        "contacts_kept": float(np.mean([r.contacts_kept for r in reports])),
        "contacts_kept_min": min(r.contacts_kept for r in reports),
        "added_foot_skate_cm_s": 100 * max(r.added_foot_skate for r in reports),
        "added_foot_skate_mean_cm_s": 100 * float(np.mean([r.added_foot_skate for r in reports])),
        "capsule_penetration_max_mm": 1e3 * max(r.capsule_penetration for r in reports),
        "seam_ratio_max": max(r.seam_ratio for r in reports),
        "knee_change_p95_max": max(r.knee_change_p95 for r in reports),
        "elbow_flips_max": max(r.elbow_flips for r in reports),
        "second_attempt_fraction": float(np.mean([r.attempt > 0 for r in reports])),
        "third_attempt_fraction": float(np.mean([r.attempt > 1 for r in reports])),
    }


def near_error_gain(reports: list[Report]) -> float:
    """Return the mean near distance error of naive scaling over ours."""
    ours, plain = (
        float(np.mean([getattr(r, name) for r in reports]))
        for name in ("near_distance_error", "near_distance_error_naive")
    )
    return plain / ours if ours else float("inf")


def summary_line(one: WindowResult) -> str:
    """Summarise a window in one line."""
    skate, peak, penetration = (
        max(getattr(r, name) for r in one.reports)
        for name in ("added_foot_skate", "seam_ratio", "capsule_penetration")
    )
    preserved = float(np.mean([r.contacts_kept for r in one.reports]))
    attempts = np.bincount([r.attempt for r in one.reports])
    return (
        f"{one.name:42} {one.seconds:6.2f} s  near error gain {near_error_gain(one.reports):5.1f}  "
        f"contacts {preserved:.4f}  foot skate {100 * skate:5.2f} cm/s  acceleration peak "
        f"{peak:4.2f}  penetration {1e3 * penetration:4.1f} mm  attempts {attempts.tolist()}"
    )


if __name__ == "__main__":
    main()
