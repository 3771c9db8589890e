"""The command line of a training run: clips and sides in, a model and its curve out."""

import argparse
import sys
from collections.abc import Callable
from pathlib import Path

from stages._params import ParamsError

PATHS = ("clips", "sides", "model", "curve")


def fold_arguments() -> argparse.Namespace:
    """Read ``CLIPS SIDES.parquet MODEL CURVE.csv``, of a model trained once a fold."""
    return _parser().parse_args()


def run_arguments(section: str) -> argparse.Namespace:
    """Read ``[--section=NAME] --seed=S CLIPS SIDES.parquet MODEL CURVE.csv``.

    Parameters
    ----------
    section : of ``params.yaml``, unless another is named
    """
    parser = _parser()
    parser.add_argument("--section", default=section, help="of params.yaml")
    parser.add_argument("--seed", type=int, required=True, help="of this run")
    return parser.parse_args()


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser()
    for name in PATHS:
        parser.add_argument(name, type=Path)
    return parser


def run_stage(main: Callable[[argparse.Namespace], None], arguments: argparse.Namespace) -> None:
    """Run a stage; refuse contradictory parameters in one line, without a traceback."""
    try:
        main(arguments)
    except ParamsError as fault:
        sys.exit(str(fault))
