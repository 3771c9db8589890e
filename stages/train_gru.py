"""Train the GRU baseline.

Usage: python -m stages.train_gru --seed=S CLIPS SIDES.parquet MODEL CURVE.csv
"""

from dataclasses import dataclass
from pathlib import Path

from pacmo_core.reaction import baselines
from pacmo_core.reaction.settings import GruSettings
from stages._params import read_params
from stages._runs import run_arguments
from stages._training import Task, sides_of, train


@dataclass(frozen=True)
class Params(GruSettings):
    """The ``train_gru`` section of ``params.yaml``."""

    threads: int


def main(clips: Path, sides: Path, model: Path, curve: Path, *, section: str, seed: int) -> None:
    params = read_params(section, Params, given={"random_seed": seed})
    found = sides_of(clips, sides)
    task = Task(
        "gru",
        params,
        found,
        lambda device: baselines.build_gru_training(
            found.train, params, validation=found.validation, device=device
        ),
        shares=False,
    )
    train(task, model, curve)


if __name__ == "__main__":
    main(**vars(run_arguments("train_gru")))
