"""Train the auto-encoder whose bottleneck gives the features of the metrics.

Usage: python -m stages.train_autoencoder CLIPS SIDES.parquet MODEL CURVE.csv
"""

from dataclasses import dataclass
from pathlib import Path

from pacmo_core.reaction import autoencoder
from pacmo_core.reaction.settings import AutoencoderSettings
from stages._params import read_params
from stages._runs import fold_arguments
from stages._training import Task, sides_of, train


@dataclass(frozen=True)
class Params(AutoencoderSettings):
    """The ``train_autoencoder`` section of ``params.yaml``."""

    threads: int


def main(clips: Path, sides: Path, model: Path, curve: Path) -> None:
    params = read_params("train_autoencoder", Params)
    found = sides_of(clips, sides)
    task = Task(
        "autoencoder",
        params,
        found,
        lambda device: autoencoder.build_training(
            found.train, params, validation=found.validation, device=device
        ),
        shares=False,
    )
    train(task, model, curve)


if __name__ == "__main__":
    main(**fold_arguments())
