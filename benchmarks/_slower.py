"""InteractionMesh beside slower solvers: the banded one of the tests, and one frame at a time."""

import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from benchmarks._per_frame import seconds_per_frame
from benchmarks._variations import SETTINGS, Task
from pacmo_core.interaction_mesh import Attempt, Scene, prepare, retarget
from pacmo_core.interaction_mesh.energy import build_energy, energy_target, energy_terms
from pacmo_core.interaction_mesh.scene import Array
from tests.interaction_mesh.oracles import banded

SHORT = 31  # frames on which the banded solver runs
BANDED_ROUNDS = 16  # after which its bones are within 1e-3; 40 are its end
SAMPLE = (0, 3)  # windows of the energy sample
SAMPLED = slice(1, None, 22)  # their variations: one of five a whole body, as in the plan
PEER_FRAMES = 3
END = Attempt(
    bone_penalty=4, max_iterations=800, separation_penalty=0, tolerance=0
)  # of our own solver
ASTRAY = 1e-3  # share by which bones miss their lengths


def beside_peers(planned: list[Task], our_seconds: float) -> dict[str, float]:
    """Compare seconds a frame, and energies where the banded solver goes to its end."""
    gaps = np.array([gap for i in SAMPLE for gap in energy_gaps(planned[i])])
    lost = gaps[:, 1] > 0
    short = shortened(planned[0])
    energy = build_energy(short.scene, SETTINGS)
    start = time.process_time()
    banded(short.scene, energy, short.scales[1], n_rounds=BANDED_ROUNDS)
    banded_seconds = (time.process_time() - start) / len(short.scene.points)
    peer = seconds_per_frame(short.scene, energy, short.scales[1], n_frames=PEER_FRAMES)
    found = {
        "energy_gap": float(gaps[~lost, 0].max(initial=0)),
        "energy_gap_where_banded_is_lost": float(gaps[lost, 0].max(initial=0)),
        "times_banded": banded_seconds / our_seconds,
    }
    return found if peer is None else found | {"times_per_frame_peer": peer / our_seconds}


def energy_gaps(task: Task) -> Iterator[tuple[float, bool]]:
    """Shares by which our energies are above the least: the banded solver's, or ours at its end.

    All have bones of exactly or nearly (1e-5) their lengths. Bodies are not kept apart: the banded
    solver does not know how. On bodies scaled as a whole it may go astray: said beside the share,
    which then is that of our end alone.
    """
    short = shortened(task)
    scales = short.scales[SAMPLED]
    alone = tuple(replace(attempt, separation_penalty=0) for attempt in SETTINGS.attempts)
    source = prepare(short.scene, replace(SETTINGS, attempts=alone))
    ended = prepare(short.scene, replace(SETTINGS, attempts=(END,)))
    both = retarget(source, scales).points, retarget(ended, scales).points
    for usual, end, own in zip(*both, scales, strict=True):
        best = banded(short.scene, source.energy, own)
        changes = np.stack([usual - short.scene.points, end - short.scene.points, best], axis=-1)
        target = np.repeat(energy_target(source.energy, own[None]), 3, axis=-1)
        terms = energy_terms(source.energy, changes, target)
        ours, settled, theirs = np.sum(list(terms.values()), axis=0)
        astray = bone_miss(short.scene, best, own) > ASTRAY
        yield float(ours / (settled if astray else min(settled, theirs)) - 1), astray


def bone_miss(scene: Scene, change: Array, scales: Array) -> float:
    """Share of its length by which a bone misses it, at worst, after a change (T, N, 3)."""
    points, (parent, child) = scene.points + change, scene.bones.T
    lengths = np.linalg.norm(points[:, child] - points[:, parent], axis=-1)
    return float(np.abs(lengths / (scales * np.linalg.norm(scene.bone_vectors, axis=-1)) - 1).max())


def shortened(task: Task) -> Task:
    """Take the first frames only."""
    motions = task.scene.motions
    cut = (motions[0][:SHORT], motions[1][:SHORT])
    return replace(task, scene=Scene(cut, task.scene.skeletons, task.scene.fps))
