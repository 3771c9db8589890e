"""Train the auto-encoder whose bottleneck gives the features of the metrics.

Usage: python -m stages.train_autoencoder CLIPS SIDES.parquet MODEL CURVE.csv
"""

import argparse
from dataclasses import dataclass

from pacmo_core.reaction.settings import AutoencoderSettings
from stages._params import read_params
from stages._runs import fold_arguments, run_stage
from stages._training import train_on_clips


@dataclass(frozen=True)
class Params(AutoencoderSettings):
    """The ``train_autoencoder`` section of ``params.yaml``."""

    threads: int


def main(paths: argparse.Namespace) -> None:
    train_on_clips("autoencoder", read_params("train_autoencoder", Params), paths)


if __name__ == "__main__":
    run_stage(main, fold_arguments())
