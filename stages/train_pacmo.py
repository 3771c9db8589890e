"""Train PaCMO, or its plain form: generator against critic.

Usage: python -m stages.train_pacmo [--section=NAME] --seed=S CLIPS SIDES.parquet MODEL CURVE.csv
Or, each batch shared by two processes: torchrun --standalone --nproc-per-node 2 -m
stages.train_pacmo --seed=S CLIPS SIDES.parquet MODEL CURVE.csv
"""

from dataclasses import dataclass
from pathlib import Path

from pacmo_core.reaction import wgan
from pacmo_core.reaction.settings import PacmoSettings
from stages._params import read_params
from stages._runs import run_arguments
from stages._training import Task, sides_of, train


@dataclass(frozen=True)
class Params(PacmoSettings):
    """The ``train_pacmo`` and ``train_pacmo_plain`` sections of ``params.yaml``."""

    threads: int


def main(clips: Path, sides: Path, model: Path, curve: Path, *, section: str, seed: int) -> None:
    params = read_params(section, Params, given={"random_seed": seed})
    found = sides_of(clips, sides)
    task = Task(
        "pacmo",
        params,
        found,
        lambda device: wgan.build_training(
            found.train,
            params,
            labels=found.train_actions,
            validation=found.validation,
            validation_labels=found.validation_actions,
            device=device,
        ),
        shares=True,
    )
    train(task, model, curve)


if __name__ == "__main__":
    main(**vars(run_arguments("train_pacmo")))
