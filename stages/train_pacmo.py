"""Train PaCMO: generator against critic.

Usage: python -m stages.train_pacmo CLIPS MODEL CURVE.csv
"""

import sys
from dataclasses import dataclass
from pathlib import Path

from pacmo_core.pacmo import adversarial
from pacmo_core.pacmo.settings import PacmoSettings
from stages._params import read_params
from stages._training import clips_of, train, use_threads, write_model


@dataclass(frozen=True)
class Params(PacmoSettings):
    """The ``train_pacmo`` section of ``params.yaml``."""

    threads: int


def main(clips: Path, model: Path, curve: Path) -> None:
    params = read_params("train_pacmo", Params)
    use_threads(params.threads)
    fitting = adversarial.fit(
        clips_of(clips, "train"), params, validation=clips_of(clips, "validation")
    )
    train(fitting, params.n_steps, curve)
    write_model(model, "pacmo", fitting.model, adversarial.config(fitting.model))


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
