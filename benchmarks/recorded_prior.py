"""A skeleton prior on recorded captures that it was not trained on, beside the solver.

Usage: python -m benchmarks.recorded_prior [--weights FILE] [--json]

The twelve windows and ten pairs of bodies of ``benchmarks.natural_motion`` (PACMO_REAL_DATA), in
the joints of the model. InteractionMesh's motions are the reference: ``e_r_...`` is the mean
distance of joints from them, ``jpd_...`` the mean error of the distances between the two people's
joints, in mm, of ``template`` (the capture, unchanged), ``start`` (the rule without training) and
``trained``, means over bodies and then windows, as generated. ``finished_...`` are the same with
the finish of ``pacmo vary``. ``e_r_change`` and ``jpd_change`` are the mean over windows of the
change by training, with a 95 % interval over windows; ``better`` counts windows. Several windows
are of the same people, so that the intervals are rough.
"""

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.stats import t as student

from benchmarks._captures import real_data
from benchmarks._figures import arguments, show
from benchmarks._recorded import in_joints
from benchmarks._retargeting_tasks import SETTINGS
from benchmarks.natural_motion import _listed, bodies
from pacmo_core.augmentation.run import scene_from, split_people
from pacmo_core.commands.weights import PACKAGED_PRIOR
from pacmo_core.data.interaction import Interaction
from pacmo_core.interaction_mesh import prepare
from pacmo_core.interaction_mesh import retarget as solve
from pacmo_core.metrics.retargeting import joint_error, pair_distance_error
from pacmo_core.models import load_skeleton_prior
from pacmo_core.skeleton_prior.inference import retarget
from pacmo_core.skeleton_prior.training import build_start
from pacmo_core.skeleton_prior.vae import SkeletonPrior

Array = NDArray[np.float64]
ROWS = ("template", "start", "trained")


def main() -> None:
    """Measure and print."""
    parser = arguments(__doc__ or "")
    parser.add_argument("--weights", type=Path, default=PACKAGED_PRIOR)
    options = parser.parse_args()
    os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    torch.set_num_threads(1)
    model = load_skeleton_prior(options.weights)
    figures: dict[str, float] = {}
    for prefix, finish in (("", False), ("finished_", True)):
        errors = np.array(list(_windows(model, finish=finish)))  # (windows, rows, 2) mm
        if not len(errors):
            raise SystemExit(
                f"no captures in {real_data()}: set PACMO_REAL_DATA to a folder of captures"
            )
        figures["windows"] = len(errors)
        for number, error in enumerate(("e_r", "jpd")):
            for row, value in zip(ROWS, errors[:, :, number].mean(axis=0), strict=True):
                figures[f"{prefix}{error}_{row}"] = float(value)
            change = errors[:, 2, number] / errors[:, 1, number] - 1
            half = student.ppf(0.975, len(change) - 1) * change.std(ddof=1) / len(change) ** 0.5
            figures[f"{prefix}{error}_change"] = float(change.mean())
            figures[f"{prefix}{error}_change_low"] = float(change.mean() - half)
            figures[f"{prefix}{error}_change_high"] = float(change.mean() + half)
            figures[f"{prefix}{error}_better"] = int((change < 0).sum())
    show(figures, as_json=options.json)


def _windows(model: SkeletonPrior, *, finish: bool) -> Iterator[Array]:
    """Yield each window's mean errors over bodies, (rows, 2) mm."""
    for window in _listed(real_data()):
        clip = in_joints(window.interaction, model.config.skeleton)
        _, scales = bodies(clip)
        scales = scales.reshape(len(scales), 2, -1)
        yield errors_of(model, clip, scales, finish=finish)


def errors_of(model: SkeletonPrior, clip: Interaction, scales: Array, *, finish: bool) -> Array:
    """Return E_r and JPD of each row against the solver, (rows, 2) mm, means over bodies.

    Parameters
    ----------
    scales : (V, 2, E)
    """
    solved = solve(prepare(scene_from(clip), SETTINGS), scales.reshape(len(scales), -1))
    truths = [split_people(points, clip).swapaxes(0, 1) for points in solved.points]
    made = [
        [np.stack([one.person_a, one.person_b], axis=1) for (one,) in motions]
        for motions in (
            retarget(mover, clip, scales, samples=1, random=None, finish=finish)
            for mover in (build_start(model.config), model)
        )
    ]
    rows = [[np.stack([clip.person_a, clip.person_b], axis=1)] * len(truths), *made]
    return 1000 * np.array(
        [
            np.mean(
                [
                    (joint_error(pair, truth).mean(), pair_distance_error(pair, truth))
                    for pair, truth in zip(row, truths, strict=True)
                ],
                axis=0,
            )
            for row in rows
        ]
    )


if __name__ == "__main__":
    main()
