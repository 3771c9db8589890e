"""Pool the scores of skeleton priors over seeds: means, and intervals for the mean of a training.

Usage: python -m stages.pool_skeleton_prior PRIORS METRICS.json

PRIORS holds scores/FAMILY/SPLIT.json; those of families and splits that are not wanted stay unread.
"""

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import t as student

from stages._files import read_json, write_json
from stages._params import read_params
from stages._priors import read_priors

TASKS = ("retargeting", "generation")


@dataclass(frozen=True)
class Params:
    """The ``pool_skeleton_prior`` section of ``params.yaml``."""

    confidence: float


def main(priors: Path, metrics: Path) -> None:
    params = read_params("pool_skeleton_prior", Params)
    rows: dict[str, Any] = {task: {} for task in TASKS}
    made_with: dict[str, Any] = {}
    for family, split in read_priors().groups():
        found = read_json(priors / "scores" / family / f"{split}.json")
        made_with.setdefault(family, {})[split] = {
            name: found[name] for name in ("extractor", "train", "tested")
        }
        for task in TASKS:
            pooled = {
                model: over_seeds([own[task] for own in seeds.values()], params.confidence)
                for model, seeds in found["models"].items()
            }
            rows[task].setdefault(family, {})[split] = pooled
    write_json(metrics, {**rows, "made_with": made_with})


def over_seeds(seeds: list[dict[str, dict[str, float]]], confidence: float) -> dict[str, Any]:
    """Pool each source's metrics: by source, by metric, mean, low and high."""
    return {
        source: {
            metric: interval([own[source][metric] for own in seeds], confidence)
            for metric in metrics
        }
        for source, metrics in seeds[0].items()
    }


def interval(values: list[float], confidence: float) -> dict[str, float]:
    """Give a mean and Student's interval for it; of one value the mean alone."""
    mean = float(np.mean(values))
    bounds = {"mean": mean}
    if len(values) > 1:
        error = float(np.std(values, ddof=1)) / len(values) ** 0.5
        reach = error * float(student.ppf((1 + confidence) / 2, len(values) - 1))
        bounds |= {"low": mean - reach, "high": mean + reach}
    return {name: float(f"{value:.6g}") for name, value in bounds.items()}


def arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser()
    for name in ("priors", "metrics"):
        parser.add_argument(name, type=Path)
    return parser.parse_args()


if __name__ == "__main__":
    main(**vars(arguments()))
