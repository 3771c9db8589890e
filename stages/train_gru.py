"""Train the GRU baseline.

Usage: python -m stages.train_gru CLIPS MODEL CURVE.csv
"""

import sys
from dataclasses import dataclass
from pathlib import Path

from pacmo_core.pacmo import gru
from pacmo_core.pacmo.settings import GruSettings
from stages._params import read_params
from stages._training import clips_of, train, use_threads, write_model


@dataclass(frozen=True)
class Params(GruSettings):
    """The ``train_gru`` section of ``params.yaml``."""

    threads: int


def main(clips: Path, model: Path, curve: Path) -> None:
    params = read_params("train_gru", Params)
    use_threads(params.threads)
    fitting = gru.fit(clips_of(clips, "train"), params, validation=clips_of(clips, "validation"))
    train(fitting, params.n_epochs, curve)
    write_model(model, "gru", fitting.model, gru.config(fitting.model))


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
