"""Train a skeleton prior or a baseline on the training variations of one split.

Usage: python -m stages.train_skeleton_prior --model=M --seed=S VARIATIONS SPLITS MODEL CURVE.csv
"""

import argparse
from dataclasses import dataclass
from pathlib import Path

from pacmo_core.data.interaction import Interaction
from pacmo_core.models import get_model
from pacmo_core.skeleton_prior.data import Example
from pacmo_core.skeleton_prior.settings import SkeletonPriorSettings
from pacmo_core.skeleton_prior.vae import SkeletonPrior
from pacmo_core.store.tables import ClipRecord, read_rows
from pacmo_core.store.weights import TrainedOn
from pacmo_core.training.devices import keep_freed_memory
from pacmo_core.training.loop import TrainingData, TrainingLoop
from stages.common.examples import stream_examples
from stages.common.files import CLIPS
from stages.common.params import read_params, run_stage
from stages.common.training import Task, train

SECTION = "train_skeleton_prior"


@dataclass(frozen=True)
class Params(SkeletonPriorSettings):
    """The ``train_skeleton_prior`` section of ``params.yaml``."""

    threads: int


def main(paths: argparse.Namespace) -> None:
    keep_freed_memory()
    given = {"random_seed": paths.seed, "model": paths.model_name}
    params = read_params(SECTION, Params, given=given)
    train_examples, validation_examples = (
        [example for _, example in stream_examples(paths.dataset, paths.splits, split)]
        for split in ("train", "validation")
    )

    model = get_model(paths.model_name, "skeleton_prior")

    def build(device: str) -> TrainingLoop[SkeletonPrior]:
        return model.build_training(
            TrainingData(train_examples, validation_examples), params, device=device
        )

    motions = TrainingData(_motions(train_examples), _motions(validation_examples))
    sources = {example.source for example in train_examples}
    records = read_rows(paths.dataset / CLIPS, ClipRecord)
    trained_on = TrainedOn.of(record for record in records if record.clip in sources)
    task = Task(model, params, motions, trained_on, build)
    train(task, paths.model, paths.curve)


def _motions(examples: list[Example]) -> list[Interaction]:
    """List the motions of a training, whose hash is metadata of the weights."""
    return [motion for example in examples for motion in (example.template, example.variation)]


def arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--model", dest="model_name", required=True)
    parser.add_argument("--seed", type=int, required=True)
    for name in ("dataset", "splits", "model", "curve"):
        parser.add_argument(name, type=Path)
    return parser.parse_args()


if __name__ == "__main__":
    run_stage(main, arguments())
