"""Train PaCMO, or PaCMO as in the paper: a conditional WGAN.

Usage: python -m stages.train_pacmo [--section=NAME] --seed=S CLIPS SIDES.parquet MODEL CURVE.csv
Or, each batch shared by two processes: torchrun --standalone --nproc-per-node 2 -m
stages.train_pacmo --seed=S CLIPS SIDES.parquet MODEL CURVE.csv
"""

import argparse
from dataclasses import dataclass

from pacmo_core.reaction.settings import PacmoSettings
from stages._params import read_params
from stages._runs import run_arguments, run_stage
from stages._training import train_on_clips


@dataclass(frozen=True)
class Params(PacmoSettings):
    """The ``train_pacmo`` and ``train_pacmo_paper`` sections of ``params.yaml``."""

    threads: int


def main(paths: argparse.Namespace) -> None:
    params = read_params(paths.section, Params, given={"random_seed": paths.seed})
    train_on_clips(paths.section.removeprefix("train_"), params, paths)


if __name__ == "__main__":
    run_stage(main, run_arguments("train_pacmo"))
