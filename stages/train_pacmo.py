"""Train PaCMO: generator against critic.

Usage: python -m stages.train_pacmo CLIPS MODEL CURVE.csv
Or, each batch shared by two processes: torchrun --standalone --nproc-per-node 2 -m
stages.train_pacmo CLIPS MODEL CURVE.csv
"""

import sys
from dataclasses import dataclass
from pathlib import Path

from pacmo_core.pacmo import adversarial
from pacmo_core.pacmo.settings import PacmoSettings
from stages._params import read_params
from stages._training import Task, sides_of, train


@dataclass(frozen=True)
class Params(PacmoSettings):
    """The ``train_pacmo`` section of ``params.yaml``."""

    threads: int


def main(clips: Path, model: Path, curve: Path) -> None:
    params = read_params("train_pacmo", Params)
    sides = sides_of(clips)
    task = Task(
        "pacmo",
        params,
        sides,
        lambda device: adversarial.fit(
            sides.train, params, validation=sides.validation, device=device
        ),
        adversarial.config,
        shares=True,
    )
    train(task, model, curve)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
