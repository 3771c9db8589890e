"""Pool the scores of skeleton priors over seeds: means, and intervals for the mean of a training.

Usage: python -m stages.pool_skeleton_prior PRIORS POOLED.json

PRIORS holds scores/DATASET/SPLIT.json of the datasets and splits of params.yaml; if it names none,
there is no such folder, and the file of pooled scores has no rows.
"""

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import t as student

from stages.common.files import read_json, write_json
from stages.common.params import read_params, read_prior_runs, run_stage

TASKS = ("retargeting", "generation")


@dataclass(frozen=True)
class Params:
    """The ``pool_skeleton_prior`` section of ``params.yaml``."""

    confidence: float


def main(priors_folder: Path, pooled_file: Path) -> None:
    params = read_params("pool_skeleton_prior", Params)
    rows: dict[str, Any] = {task: {} for task in TASKS}
    data_facts: dict[str, Any] = {}
    for dataset, split in read_prior_runs().groups():
        scores = read_json(priors_folder / "scores" / dataset / f"{split}.json")
        data_facts.setdefault(dataset, {})[split] = {
            name: scores[name] for name in ("extractor", "train", "tested")
        }
        for task in TASKS:
            pooled = {
                model: over_seeds(
                    [scores_of_seed[task] for scores_of_seed in seeds.values()], params.confidence
                )
                for model, seeds in scores["models"].items()
            }
            rows[task].setdefault(dataset, {})[split] = pooled
    write_json(pooled_file, {**rows, "data_facts": data_facts})


def over_seeds(seeds: list[dict[str, dict[str, float]]], confidence: float) -> dict[str, Any]:
    """Pool each source's metrics: by source, by metric, mean, low and high."""
    return {
        source: {
            metric: interval(
                [scores_of_seed[source][metric] for scores_of_seed in seeds], confidence
            )
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
        half_width = error * float(student.ppf((1 + confidence) / 2, len(values) - 1))
        bounds |= {"low": mean - half_width, "high": mean + half_width}
    return {name: float(f"{value:.6g}") for name, value in bounds.items()}


def arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser()
    for name in ("priors_folder", "pooled_file"):
        parser.add_argument(name, type=Path)
    return parser.parse_args()


if __name__ == "__main__":
    run_stage(main, **vars(arguments()))
