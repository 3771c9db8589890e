"""Train PaCMO on a fold's clips and their variations, step for step as ``train_pacmo`` does.

Usage: python -m stages.train_pacmo_augmented [--section=NAME] --seed=S --share=P
           CLIPS SIDES.parquet VARIATIONS MODEL CURVE.csv

VARIATIONS is a folder with a file a clip. Only variations of the clips that are trained on are
seen. Weights are chosen on validation clips as they were captured.
"""

import argparse
from dataclasses import dataclass, replace
from pathlib import Path

from pacmo_core.data.names import split_variation_name
from pacmo_core.models import MODELS
from pacmo_core.reaction.settings import PacmoSettings
from pacmo_core.reaction.variations import TrainingVariations
from pacmo_core.store.motions import stream_folder
from stages._clips import stream_side
from stages._params import read_params
from stages._runs import run_stage
from stages._training import Task, read_training_data, train


@dataclass(frozen=True)
class Params(PacmoSettings):
    """The ``train_pacmo`` section of ``params.yaml``, and what the command line adds."""

    threads: int
    share: float  # of a clip's showings in which a variation stands for it


def main(paths: argparse.Namespace) -> None:
    given = {"random_seed": paths.seed, "share": paths.share}
    params = read_params(paths.section, Params, given=given)
    data = read_training_data(paths.clips, paths.sides)
    variations = variations_of(paths, params.share)
    model = MODELS["pacmo_augmented"]
    task = Task(
        model,
        params,
        # All that it is trained on, and so what a checkpoint depends on.
        replace(data, train=[*data.train, *variations.interactions]),
        lambda device: model.build_training(data, params, device=device, variations=variations),
    )
    train(task, paths.model, paths.curve)


def variations_of(paths: argparse.Namespace, share: float) -> TrainingVariations:
    """Hold the variations of the training clips in memory.

    Raises
    ------
    ValueError
        If there are none.
    """
    trained = stream_side(paths.clips, paths.sides, "train")
    numbers = {facts.clip: number for number, (facts, _) in enumerate(trained)}
    made, sources = [], []
    for name, motion in stream_folder(paths.variations):
        source, _ = split_variation_name(name)
        if source in numbers:
            made.append(motion)
            sources.append(numbers[source])
    if not made:
        raise ValueError(f"{paths.variations}: wanted variations of the side train, found none")
    return TrainingVariations(interactions=made, sources=sources, share=share)


def arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser()
    for name in ("clips", "sides", "variations", "model", "curve"):
        parser.add_argument(name, type=Path)
    parser.add_argument("--section", default="train_pacmo", help="of params.yaml")
    parser.add_argument("--seed", type=int, required=True, help="of this run")
    parser.add_argument("--share", type=float, required=True, help="of varied showings")
    return parser.parse_args()


if __name__ == "__main__":
    run_stage(main, arguments())
