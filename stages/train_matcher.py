"""Train the matcher, which tells which partner a reaction answers.

Usage: python -m stages.train_matcher CLIPS SIDES.parquet MODEL CURVE.csv
"""

from dataclasses import dataclass
from pathlib import Path

from pacmo_core.reaction import matcher
from pacmo_core.reaction.settings import MatcherSettings
from stages._params import read_params
from stages._runs import fold_arguments
from stages._training import Task, sides_of, train


@dataclass(frozen=True)
class Params(MatcherSettings):
    """The ``train_matcher`` section of ``params.yaml``."""

    threads: int


def main(clips: Path, sides: Path, model: Path, curve: Path) -> None:
    params = read_params("train_matcher", Params)
    found = sides_of(clips, sides)
    task = Task(
        "matcher",
        params,
        found,
        lambda device: matcher.build_training(
            found.train, params, validation=found.validation, device=device
        ),
        shares=False,
    )
    train(task, model, curve)


if __name__ == "__main__":
    main(**fold_arguments())
