"""Train the matcher of partners and reactions, for the metric ``matching``.

Usage: python -m stages.train_matcher CLIPS SIDES.parquet MODEL CURVE.csv
"""

import argparse
from dataclasses import dataclass

from pacmo_core.reaction.settings import MatcherSettings
from stages._params import read_params
from stages._runs import fold_arguments, run_stage
from stages._training import train_on_clips


@dataclass(frozen=True)
class Params(MatcherSettings):
    """The ``train_matcher`` section of ``params.yaml``."""

    threads: int


def main(paths: argparse.Namespace) -> None:
    train_on_clips("matcher", read_params("train_matcher", Params), paths)


if __name__ == "__main__":
    run_stage(main, fold_arguments())
