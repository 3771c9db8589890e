"""Train the matcher, which tells which partner a reaction answers.

Usage: python -m stages.train_matcher CLIPS SIDES MODEL CURVE.csv
"""

import sys
from dataclasses import dataclass
from pathlib import Path

from pacmo_core.pacmo import matching
from pacmo_core.pacmo.settings import MatcherSettings
from stages._params import read_params
from stages._training import clips_of, train, use_threads, write_model


@dataclass(frozen=True)
class Params(MatcherSettings):
    """The ``train_matcher`` section of ``params.yaml``."""

    threads: int


def main(clips: Path, sides: Path, model: Path, curve: Path) -> None:
    params = read_params("train_matcher", Params)
    use_threads(params.threads)
    fitting = matching.fit(
        clips_of(clips, sides, "train"), params, validation=clips_of(clips, sides, "validation")
    )
    train(fitting, params.n_epochs, curve)
    write_model(model, "matcher", fitting.model, matching.config(fitting.model))


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
