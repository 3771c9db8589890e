"""Accuracy and training time of mixed precision, for a skeleton prior of the paper's size.

Usage: python -m benchmarks.mixed_precision [--json] [--dataset D] [--split S] [--seeds N ...]

Trains the kinematic model as in the experiment ``variations_paper``, in float32 and with bfloat16
products in turn, on variations of the project: ``./run pacmo use variations_paper`` and
``./run flow split_variations`` make them. ``error_mm`` is the mean position error on the test split
on given skeletons; seconds are processor time of one thread. Results are means over seeds, and the
largest of the differences.
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

SPLITS = ("train", "validation", "test")


@dataclass(frozen=True)
class Result:
    """Test error, millimetres, and training time, seconds."""

    error_mm: float
    seconds: float


def main() -> None:
    """Train, measure and print."""
    parser = arguments(__doc__ or "")
    parser.add_argument("--dataset", default="cmu_18_19", help="a folder of data/variations")
    parser.add_argument("--split", default="cross_scale_interaction")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    options = parser.parse_args()
    if not supports_bfloat16("cpu"):
        parser.error("this processor does not support bfloat16 products: nothing to compare")
    torch.set_num_threads(1)
    keep_freed_memory()  # as the training stage does
    splits = Path("data/priors/splits") / options.dataset / f"{options.split}.parquet"
    variations = Path("data/variations", options.dataset)
    examples = [
        [example for _, example in stream_examples(variations, splits, split)] for split in SPLITS
    ]
    results = [
        [train(examples, seed, mixed_precision=mixed) for mixed in (False, True)]
        for seed in options.seeds
    ]
    errors = np.array([[result.error_mm for result in pair] for pair in results])
    seconds = np.array([[result.seconds for result in pair] for pair in results])
    figures = {
        "error_mm": errors[:, 0].mean(),
        "mixed_error_mm": errors[:, 1].mean(),
        "largest_difference_mm": np.abs(errors[:, 1] - errors[:, 0]).max(),
        "spread_of_seeds_mm": np.ptp(errors[:, 0]),
        "seconds": seconds[:, 0].mean(),
        "mixed_seconds": seconds[:, 1].mean(),
    }
    show(figures, as_json=options.json)


def train(examples: list[list[Example]], seed: int, *, mixed_precision: bool) -> Result:
    """Train on the first split, select weights on the second, measure on the third."""
    section = YAML(typ="safe").load(compose_params("variations_paper"))["train_skeleton_prior"]
    overrides = {
        "random_seed": seed,
        "model": "kinematic",
        "mixed_precision": mixed_precision,
        "loss_weights": LossWeights(**section["loss_weights"]),
    }
    settings = {key: value for key, value in section.items() if key != "threads"} | overrides
    training_data, validation, test = examples
    start = time.process_time()
    model = training.build_training(
        training_data, SkeletonPriorSettings(**settings), validation=validation
    ).finish()
    seconds = time.process_time() - start
    with torch.no_grad():
        error = float(training.mean_position_error(model, encode_examples(test)))
    return Result(1e3 * error, seconds)


if __name__ == "__main__":
    main()
