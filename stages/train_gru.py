"""Train the GRU baseline.

Usage: python -m stages.train_gru CLIPS MODEL CURVE.csv
"""

import sys
from dataclasses import dataclass
from pathlib import Path

from pacmo_core.pacmo import gru
from pacmo_core.pacmo.settings import GruSettings
from stages._params import read_params
from stages._training import Task, sides_of, train


@dataclass(frozen=True)
class Params(GruSettings):
    """The ``train_gru`` section of ``params.yaml``."""

    threads: int


def main(clips: Path, model: Path, curve: Path) -> None:
    params = read_params("train_gru", Params)
    sides = sides_of(clips)
    task = Task(
        "gru",
        params,
        sides,
        lambda device: gru.fit(sides.train, params, validation=sides.validation, device=device),
        gru.config,
        shares=False,
    )
    train(task, model, curve)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
