"""InteractionMesh beside slower solvers: the banded one of the tests, and one frame at a time."""

import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from benchmarks._per_frame import seconds_per_frame
from benchmarks._variations import SETTINGS, Task
from pacmo_core.interaction_mesh import Scene, prepare, vary
from pacmo_core.interaction_mesh.energy import energy_terms, quadratic, target_of
from tests.interaction_mesh.oracles import banded

SHORT = 31  # frames on which the banded solver runs
BANDED_ROUNDS = 16  # after which its bones are within 1e-3; 40 are its end
SAMPLE = (0, 3)  # windows of the energy sample
SAMPLED = slice(1, None, 22)  # their variations: one of five a whole body, as in the plan
PEER_FRAMES = 3


def beside_peers(planned: list[Task], our_seconds: float) -> dict[str, float]:
    """Compare seconds a frame, and energies where the banded solver goes to its end."""
    gaps = [gap for i in SAMPLE for gap in energy_gaps(planned[i])]
    short = shortened(planned[0])
    energy = quadratic(short.scene, SETTINGS)
    start = time.process_time()
    banded(short.scene, energy, short.scales[1], n_rounds=BANDED_ROUNDS)
    banded_seconds = (time.process_time() - start) / len(short.scene.points)
    peer = seconds_per_frame(short.scene, energy, short.scales[1], n_frames=PEER_FRAMES)
    found = {
        "energy_gap": max(gaps),
        "times_banded": banded_seconds / our_seconds,
    }
    return found if peer is None else found | {"times_per_frame_peer": peer / our_seconds}


def energy_gaps(task: Task) -> Iterator[float]:
    """Shares by which our energies are above the banded solver's at its end.

    Bodies are not kept apart: the banded solver does not know how. Below 0 it got stuck.
    """
    short = shortened(task)
    scales = short.scales[SAMPLED]
    alone = tuple(replace(rung, apart=0) for rung in SETTINGS.rungs)
    source = prepare(short.scene, replace(SETTINGS, rungs=alone))
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
