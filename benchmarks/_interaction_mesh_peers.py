"""Slower solvers of the same energy: the banded one of the tests, and an emulation per frame.

The emulation is of per-frame retargeters in general, written for this benchmark: it solves our
energy, without the terms of later frames, by a sequence of ten convex programs per frame (CVXPY and
Clarabel), bone lengths linearised, steps within a trust region. A published retargeter is measured
in ``_holosoma.py``.
"""

import importlib
import importlib.util
import sys
import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchmarks._captures import real_data
from benchmarks._retargeting_tasks import SETTINGS, Task
from pacmo_core.formats.bvh import read_bvh
from pacmo_core.interaction_mesh import Attempt, Scene, prepare, retarget
from pacmo_core.interaction_mesh.energy import (
    QuadraticEnergy,
    build_energy,
    energy_of,
    energy_rhs,
)
from pacmo_core.interaction_mesh.report import mean_accelerations, seam_ratios
from pacmo_core.interaction_mesh.scene import Array
from tests.interaction_mesh.oracles import banded, rigid_pairs

EMULATION_PACKAGES = ("cvxpy", "clarabel")
PROGRAMS_PER_FRAME = 10
TRUST_REGION = 0.2
N_SHORT_FRAMES = 31  # frames on which the banded solver runs
BANDED_ROUNDS = 16  # after which its relative bone errors are within 1e-3; it converges in 40
SAMPLE_WINDOWS = (0, 3)  # windows whose energies are compared
SAMPLE_VARIATIONS = slice(1, None, 22)  # of these; one of five is a whole body, as in the plan
EMULATION_FRAMES = 3
LONG_ATTEMPT = Attempt(bone_penalty=4, max_iterations=800, pair_penalty=0, tolerance=0)
DIVERGED_BONE_ERROR = 1e-3  # relative
RELEASED_WINDOW = 40  # frames; all released motions have seams between such windows


def seconds_per_frame_emulation(
    scene: Scene, energy: QuadraticEnergy, scales: NDArray[np.float64], *, n_frames: int
) -> float | None:
    """Return the process seconds per frame on a few frames; None if the packages are missing."""
    if any(importlib.util.find_spec(name) is None for name in EMULATION_PACKAGES):
        print("the emulation is not measured: pip install cvxpy clarabel", file=sys.stderr)
        return None
    rhs = energy_rhs(energy, scales[None])[..., 0]
    done = [np.zeros_like(scene.points[0])] * 2
    _solve_frame(scene, energy, scales, rhs, 0, done)  # the first use compiles
    start = time.process_time()
    for frame in range(n_frames):
        done.append(_solve_frame(scene, energy, scales, rhs, frame, done))
    return (time.process_time() - start) / n_frames


def _solve_frame(
    scene: Scene,
    energy: QuadraticEnergy,
    scales: NDArray[np.float64],
    rhs: NDArray[np.float32],
    frame: int,
    done: list[NDArray[np.float64]],
) -> NDArray[np.float64]:
    cp = importlib.import_module("cvxpy")
    parent, child = scene.bones.T
    lengths = np.linalg.norm(scene.bone_vectors[frame], axis=-1) * scales
    root = np.linalg.cholesky(energy.frame_hessians[frame])
    current = done[-1].copy()
    for _ in range(PROGRAMS_PER_FRAME):
        displacement = cp.Variable(current.shape)
        vectors = scene.bone_vectors[frame] + current[child] - current[parent]
        current_lengths = np.linalg.norm(vectors, axis=1)
        along = vectors / current_lengths[:, None]
        step = displacement[child] - displacement[parent] - (current[child] - current[parent])
        cost = (
            cp.sum_squares(root.T @ displacement)
            - 2 * cp.sum(cp.multiply(rhs[frame], displacement))
            + energy.acceleration * cp.sum_squares(displacement - 2 * done[-1] + done[-2])
        )
        constraints = [
            cp.sum(cp.multiply(along, step), axis=1) == lengths - current_lengths,
            cp.norm(displacement - current, "fro") <= TRUST_REGION * np.sqrt(len(current)),
        ]
        cp.Problem(cp.Minimize(cost), constraints).solve(solver="CLARABEL")
        current = np.asarray(displacement.value)
    return current


def compare_with_peers(planned: list[Task], our_seconds: float) -> dict[str, float]:
    """Compare process seconds per frame, and energies at convergence of the banded solver."""
    gaps = np.array([gap for i in SAMPLE_WINDOWS for gap in energy_gaps(planned[i])])
    has_diverged = gaps[:, 1] > 0
    short = shortened(planned[0])
    energy = build_energy(short.scene, SETTINGS)
    start = time.process_time()
    rigid = rigid_pairs(short.scene)
    banded(short.scene, energy, short.scales[1], rigid, n_rounds=BANDED_ROUNDS)
    banded_seconds = (time.process_time() - start) / len(short.scene.points)
    emulation = seconds_per_frame_emulation(
        short.scene, energy, short.scales[1], n_frames=EMULATION_FRAMES
    )
    result = {
        "energy_gap": float(gaps[~has_diverged, 0].max(initial=0)),
        "energy_gap_where_banded_diverged": float(gaps[has_diverged, 0].max(initial=0)),
        "from_minimum_mm": float(1000 * gaps[:, 2].max()),
        "times_banded": banded_seconds / our_seconds,
    }
    if emulation is not None:
        result["times_per_frame_emulation"] = emulation / our_seconds
    return result


def energy_gaps(task: Task) -> Iterator[tuple[float, bool, float]]:
    """Yield the relative excess of our energies, whether `banded` diverged, and a distance.

    The minimum is that of the banded solver and of a long attempt of ours; of the latter alone
    where the banded solver diverged. Relative bone errors are zero or nearly so (1e-5). Without
    separation constraints, which the banded solver does not have. The distance is the largest of a
    joint, in metres, from where the long attempt has it: of one small bone the energy is nearly
    zero, and a large part of it hardly moves anything.
    """
    short = shortened(task)
    scales = short.scales[SAMPLE_VARIATIONS]
    attempts = tuple(replace(attempt, pair_penalty=0) for attempt in SETTINGS.attempts)
    # The banded solver knows neither bounds between the bodies nor a floor.
    settings = replace(SETTINGS, attempts=attempts, floor_penalty=0)
    source = prepare(short.scene, settings)
    long_source = prepare(short.scene, replace(settings, attempts=(LONG_ATTEMPT,)))
    energy = source.only_window.energy
    both = retarget(source, scales).points, retarget(long_source, scales).points
    for points, long_points, body_scales in zip(*both, scales, strict=True):
        reference = banded(short.scene, energy, body_scales, rigid_pairs(short.scene))
        displacements = np.stack(
            [points - short.scene.points, long_points - short.scene.points, reference], axis=-1
        )
        repeated = np.repeat(body_scales[None], 3, axis=0)
        ours, long, theirs = energy_of(energy, displacements, repeated)
        error = relative_bone_error(short.scene, reference, body_scales)
        has_diverged = error > DIVERGED_BONE_ERROR
        away = float(np.linalg.norm(points - long_points, axis=-1).max())
        yield float(ours / (long if has_diverged else min(long, theirs)) - 1), has_diverged, away


def relative_bone_error(scene: Scene, displacement: Array, scales: Array) -> float:
    """Return the largest relative error of a bone length after a displacement (T, N, 3)."""
    points, (parent, child) = scene.points + displacement, scene.bones.T
    lengths = np.linalg.norm(points[:, child] - points[:, parent], axis=-1)
    targets = scales * np.linalg.norm(scene.bone_vectors, axis=-1)
    return float(np.abs(lengths / targets - 1).max())


def shortened(task: Task) -> Task:
    """Return the task with its first frames only."""
    motions = task.scene.motions
    cut = (motions[0][:N_SHORT_FRAMES], motions[1][:N_SHORT_FRAMES])
    return replace(task, scene=Scene(cut, task.scene.skeletons, task.scene.fps))


def released_seam_ratio() -> float | None:
    """Return the seam ratio of the augmentation paper's released motions, at worst.

    Between their windows only: the sample has no source to which other peaks could be compared.
    """
    root = real_data() / "skeleton_priors"
    files = sorted(root.rglob("*.bvh"))
    if not files:
        return None
    # Row i is the acceleration of frame i + 1.
    between_windows = slice(RELEASED_WINDOW - 2, None, RELEASED_WINDOW)
    return max(
        float(
            seam_ratios(mean_accelerations(read_bvh(f).positions()[..., None]), 10)[
                between_windows
            ].max()
        )
        for f in files
    )
