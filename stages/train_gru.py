"""Train the GRU baseline.

Usage: python -m stages.train_gru --seed=S CLIPS SIDES.parquet MODEL CURVE.csv
"""

import argparse
from dataclasses import dataclass

from pacmo_core.reaction.settings import GruSettings
from stages._params import read_params
from stages._runs import run_arguments, run_stage
from stages._training import train_on_clips


@dataclass(frozen=True)
class Params(GruSettings):
    """The ``train_gru`` section of ``params.yaml``."""

    threads: int


def main(paths: argparse.Namespace) -> None:
    params = read_params(paths.section, Params, given={"random_seed": paths.seed})
    train_on_clips("gru", params, paths)


if __name__ == "__main__":
    run_stage(main, run_arguments("train_gru"))
