"""What products of bfloat16 do to what a prior of the paper's size learns, and how long that takes.

Usage: python -m benchmarks.mixed_precision [--json] [--family F] [--split S] [--seeds N ...]

Trains our form as the experiment ``variations_paper`` does, with factors rounded and not, in turn,
on variations that stand in the project: ``./run pacmo use variations_paper`` and ``./run flow
split_variations`` make them. ``error_mm`` is the mean error of joints' places over the test side,
bodies given; seconds are of the process, on one thread. Figures are means over seeds, and of the
differences the largest.
"""

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from ruamel.yaml import YAML

from benchmarks._figures import arguments, show
from pacmo_core.project.experiments import compose_params
from pacmo_core.skeleton_prior import training
from pacmo_core.skeleton_prior.autograd_functions import supports_bfloat16
from pacmo_core.skeleton_prior.data import Example, encode_examples
from pacmo_core.skeleton_prior.settings import LossWeights, SkeletonPriorSettings
from pacmo_core.training.devices import keep_freed_memory
from stages.common.examples import stream_examples

SIDES = ("train", "validation", "test")


@dataclass(frozen=True)
class Trained:
    """What came of a training: millimetres and seconds."""

    error_mm: float
    seconds: float


def main() -> None:
    """Train, measure and print."""
    parser = arguments(__doc__ or "")
    parser.add_argument("--family", default="cmu_18_19", help="a folder of data/variations")
    parser.add_argument("--split", default="cross_scale_interaction")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    options = parser.parse_args()
    if not supports_bfloat16("cpu"):
        parser.error("this processor has no products of bfloat16: there is nothing to compare")
    torch.set_num_threads(1)
    keep_freed_memory()  # as the stage that trains does
    sides = Path("data/priors/splits") / options.family / f"{options.split}.parquet"
    examples = [
        [
            example
            for _, example in stream_examples(Path("data/variations", options.family), sides, side)
        ]
        for side in SIDES
    ]
    found = [[trained(examples, seed, mixed) for mixed in (False, True)] for seed in options.seeds]
    errors = np.array([[each.error_mm for each in pair] for pair in found])
    seconds = np.array([[each.seconds for each in pair] for pair in found])
    figures = {
        "error_mm": errors[:, 0].mean(),
        "mixed_error_mm": errors[:, 1].mean(),
        "largest_difference_mm": np.abs(errors[:, 1] - errors[:, 0]).max(),
        "spread_of_seeds_mm": np.ptp(errors[:, 0]),
        "seconds": seconds[:, 0].mean(),
        "mixed_seconds": seconds[:, 1].mean(),
    }
    show(figures, as_json=options.json)


def trained(examples: list[list[Example]], seed: int, mixed: bool) -> Trained:
    """Train on the first side, choose weights on the second, measure on the third."""
    section = YAML(typ="safe").load(compose_params("variations_paper"))["train_skeleton_prior"]
    own = {
        "random_seed": seed,
        "model": "kinematic",
        "mixed_precision": mixed,
        "loss_weights": LossWeights(**section["loss_weights"]),
    }
    known = {key: value for key, value in section.items() if key != "threads"}
    learnt, held_out, tested = examples
    start = time.process_time()
    model = training.build_training(
        learnt, SkeletonPriorSettings(**{**known, **own}), validation=held_out
    ).finish()
    seconds = time.process_time() - start
    with torch.no_grad():
        return Trained(
            1e3 * float(training.mean_position_error(model, encode_examples(tested))), seconds
        )


if __name__ == "__main__":
    main()
