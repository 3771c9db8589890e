"""How fast and how well 967 variations of nine two-person motions are made, beside the peers.

Usage: python -m benchmarks.interaction_mesh [--json]

Two processes share the nine windows; times of ours include factorisation, retries and reports, not
reading. ``times_banded`` and ``times_per_frame_peer`` compare process seconds a frame: the banded
solver on one variation of a shorter window, the per-frame solver (``pip install cvxpy clarabel``)
on a few frames; both extrapolated. ``energy_gap`` is the worst of a few variations of shorter
windows against the banded solver run to its end. Of figures of single variations the worst counts;
``contacts_kept`` and ``flip_share`` are means, with the worst beside them; ``near_error_gain`` is
the mean error of naive scaling over ours, by source.
"""

import resource
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context

import numpy as np

from benchmarks._figures import arguments, show
from benchmarks._per_frame import seconds_per_frame
from benchmarks._variations import SETTINGS, Task, tasks
from pacmo_core.interaction_mesh import Report, Scene, prepare, vary, vary_in_batches
from pacmo_core.interaction_mesh.energy import energy_terms, quadratic, target_of
from pacmo_core.interaction_mesh.scene import Array
from tests.interaction_mesh.oracles import banded

N_PROCESSES = 2
SHORT = 31  # frames on which the banded solver runs
BANDED_ROUNDS = 16  # after which its bones are within 1e-3; 40 are its end
SAMPLE = (0, 3)  # windows of the energy sample
PEER_FRAMES = 3


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
    options = arguments(__doc__ or "").parse_args()
    kind, planned = tasks()
    print(f"{kind} windows; {sum(len(task.scales) for task in planned)} variations", flush=True)
    start = time.perf_counter()
    # Spawned, not forked: a process then holds its own memory alone.
    with ProcessPoolExecutor(N_PROCESSES, mp_context=get_context("spawn")) as pool:
        done = list(pool.map(run, planned))
    wall = time.perf_counter() - start
    for one in done:
        print(line(one), flush=True)
    figures = speed(done, wall) | quality(done)
    figures |= beside_peers(planned, 1 / figures["frames_per_s_per_core"])
    show(figures, as_json=options.json)


def run(task: Task) -> Done:
    """Vary one window in all planned ways; motions are dropped once they are measured."""
    start = time.process_time()
    source = prepare(task.scene, SETTINGS)
    reports: list[Report] = []
    worst = spent = 0.0
    for batch in vary_in_batches(source, task.scales):
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
        np.abs(lengths - scales[:, None] * np.linalg.norm(task.scene.vectors, axis=-1)).max()
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
        "max_raw_residual": max(r.raw_residual for r in reports),
        "near_error_gain_min": min(gains.values()),
        "near_error_gain_salsa": min(salsa) if salsa else float("nan"),
        "contacts_kept": float(np.mean([r.contacts_kept for r in reports])),
        "contacts_kept_least": min(r.contacts_kept for r in reports),
        "added_slide_cm_s": 100 * max(r.added_slide for r in reports),
        "added_slide_mean_cm_s": 100 * float(np.mean([r.added_slide for r in reports])),
        "penetration_max_mm": 1e3 * max(r.penetration for r in reports),
        "seam_ratio_max": max(r.seam_ratio for r in reports),
        "flip_share": float(np.mean([r.flip_share for r in reports])),
        "flip_share_most": max(r.flip_share for r in reports),
        "retried_share": float(np.mean([r.rung > 0 for r in reports])),
        "laddered_share": float(np.mean([r.rung > 1 for r in reports])),
    }


def near_gain(reports: list[Report]) -> float:
    """How many times naive scaling's error of near distances is ours."""
    ours, plain = (
        float(np.mean([getattr(r, name) for r in reports]))
        for name in ("near_error", "near_error_naive")
    )
    return plain / ours if ours else float("inf")


def line(one: Done) -> str:
    """Say how a window went."""
    slide, seam, deep = (
        max(getattr(r, name) for r in one.reports)
        for name in ("added_slide", "seam_ratio", "penetration")
    )
    kept = float(np.mean([r.contacts_kept for r in one.reports]))
    rungs = np.bincount([r.rung for r in one.reports])
    return (
        f"{one.name:42} {one.seconds:6.2f} s  near gain {near_gain(one.reports):5.1f}  kept "
        f"{kept:.4f}  slide {100 * slide:5.2f} cm/s  seam {seam:4.2f}  deeper {1e3 * deep:4.1f} mm"
        f"  rungs {rungs.tolist()}"
    )


def beside_peers(planned: list[Task], our_seconds: float) -> dict[str, float]:
    """Compare seconds a frame, and energies where the banded solver goes to its end."""
    gaps = [gap for task in (planned[i] for i in SAMPLE) for gap in energy_gaps(task)]
    short = shortened(planned[0])
    energy = quadratic(short.scene, SETTINGS)
    start = time.process_time()
    banded(short.scene, energy, short.scales[1], n_rounds=BANDED_ROUNDS)
    banded_seconds = (time.process_time() - start) / len(short.scene.points)
    peer = seconds_per_frame(short.scene, energy, short.scales[1], n_frames=PEER_FRAMES)
    found = {"energy_gap": max(gaps), "times_banded": banded_seconds / our_seconds}
    return found if peer is None else found | {"times_per_frame_peer": peer / our_seconds}


def energy_gaps(task: Task) -> Iterator[float]:
    """Shares by which our energy is above the banded solver's: one body grown, and one bone."""
    short = shortened(task)
    scales = short.scales[[1, -1]]
    source = prepare(short.scene, SETTINGS)
    found = vary(source, scales)
    for points, own in zip(found.points, scales, strict=True):
        best = banded(short.scene, source.energy, own)
        changes = np.stack([points - short.scene.points, best], axis=-1)
        target = target_of(source.energy, own[None])
        target = np.repeat(target, 2, axis=-1)
        ours, theirs = np.sum(list(energy_terms(source.energy, changes, target).values()), axis=0)
        yield float(ours / theirs - 1)


def shortened(task: Task) -> Task:
    """Take the first frames only."""
    motions = task.scene.motions
    cut = (motions[0][:SHORT], motions[1][:SHORT])
    return replace(task, scene=Scene(cut, task.scene.skeletons, task.scene.fps))


if __name__ == "__main__":
    main()
