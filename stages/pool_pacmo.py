"""Pool the scores of folds: here, the first.

Usage: python -m stages.pool_pacmo --scores DIR --metrics JSON
"""

import argparse
from pathlib import Path

from stages._files import read_json, write_json


def main(scores: Path, metrics: Path) -> None:
    write_json(metrics, read_json(min(scores.iterdir())))


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    for argument in ("scores", "metrics"):
        parser.add_argument(f"--{argument}", type=Path, required=True)
    main(**vars(parser.parse_args()))
