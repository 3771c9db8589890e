"""Train the auto-encoder whose bottleneck gives the features of the metrics.

Usage: python -m stages.train_autoencoder CLIPS MODEL CURVE.csv
"""

import sys
from dataclasses import dataclass
from pathlib import Path

from pacmo_core.pacmo import autoencoder
from pacmo_core.pacmo.settings import AutoencoderSettings
from stages._params import read_params
from stages._training import Task, sides_of, train


@dataclass(frozen=True)
class Params(AutoencoderSettings):
    """The ``train_autoencoder`` section of ``params.yaml``."""

    threads: int


def main(clips: Path, model: Path, curve: Path) -> None:
    params = read_params("train_autoencoder", Params)
    sides = sides_of(clips)
    task = Task(
        "autoencoder",
        params,
        sides,
        lambda device: autoencoder.fit(
            sides.train, params, validation=sides.validation, device=device
        ),
        autoencoder.config,
        shares=False,
    )
    train(task, model, curve)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
