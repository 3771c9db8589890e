"""The per-frame peer: each frame a sequence of convex programs, by CVXPY and Clarabel.

What frame-by-frame retargeting does (OmniRetarget's public code, for one): ten programs a frame,
bones linearised about the last one, steps held within a trust region, smooth against the frames
before. The same energy as ours, less what looks ahead.
"""

import importlib
import importlib.util
import sys
import time

import numpy as np
from numpy.typing import NDArray

from pacmo_core.interaction_mesh import Scene
from pacmo_core.interaction_mesh.energy import QuadraticEnergy, energy_target

PEERS = ("cvxpy", "clarabel")
N_PROGRAMS = 10
TRUST = 0.2


def seconds_per_frame(
    scene: Scene, energy: QuadraticEnergy, scales: NDArray[np.float64], *, n_frames: int
) -> float | None:
    """Time the peer on a few frames, or say how to get it: process seconds a frame."""
    if any(importlib.util.find_spec(name) is None for name in PEERS):
        print("no per-frame peer here: pip install cvxpy clarabel", file=sys.stderr)
        return None
    target = energy_target(energy, scales[None])[..., 0]
    done = [np.zeros_like(scene.points[0])] * 2
    _solve_frame(scene, energy, scales, target, 0, done)  # the first use compiles
    start = time.process_time()
    for frame in range(n_frames):
        done.append(_solve_frame(scene, energy, scales, target, frame, done))
    return (time.process_time() - start) / n_frames


def _solve_frame(
    scene: Scene,
    energy: QuadraticEnergy,
    scales: NDArray[np.float64],
    target: NDArray[np.float64],
    frame: int,
    done: list[NDArray[np.float64]],
) -> NDArray[np.float64]:
    cp = importlib.import_module("cvxpy")
    parent, child = scene.bones.T
    lengths = np.linalg.norm(scene.bone_vectors[frame], axis=-1) * scales
    ties = energy.contact_weights[frame]
    root = np.linalg.cholesky(np.diag(ties.sum(axis=1) + energy.regularisation) - ties)
    now = done[-1].copy()
    for _ in range(N_PROGRAMS):
        change = cp.Variable(now.shape)
        vectors = scene.bone_vectors[frame] + now[child] - now[parent]
        now_long = np.linalg.norm(vectors, axis=1)
        along = vectors / now_long[:, None]
        turned = change[child] - change[parent] - (now[child] - now[parent])
        cost = (
            cp.sum_squares(energy.laplacians[frame] @ change - target[frame])
            + energy.acceleration * cp.sum_squares(change - 2 * done[-1] + done[-2])
            + cp.sum_squares(root.T @ change)
        )
        held = [
            cp.sum(cp.multiply(along, turned), axis=1) == lengths - now_long,
            cp.norm(change - now, "fro") <= TRUST * np.sqrt(len(now)),
        ]
        cp.Problem(cp.Minimize(cost), held).solve(solver="CLARABEL")
        now = np.asarray(change.value)
    return now
