"""Pool the scores of skeleton priors: means with intervals, and what training adds to the start.

Usage: python -m stages.pool_skeleton_prior PRIORS POOLED.json

PRIORS holds scores/DATASET/SPLIT.json of the datasets and splits of params.yaml; if it names none,
there is no such folder, and the file of pooled scores has no rows. Folds of a split, of which each
tests other motions, are pooled.

An interval of one motion is Student's over seeds. That of all motions is over motions and seeds:
the squared standard errors of the mean over the motions and over the seeds are added, and the
degrees of freedom are those of the fewer units. ``gain`` is by how much a trained model's error is
below the untrained start's, as a share of it, motion by motion and seed by seed. It names the files
of weights that it is of by their hashes: ``pacmo vary`` reads it to choose between weights and
their start.
"""

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from stages.common.files import ALL_SOURCES, START, read_json, write_json
from stages.common.params import (
    PriorRuns,
    parse_split_name,
    read_params,
    read_prior_runs,
    run_stage,
)

TASKS = ("retargeting", "generation")
# Errors of which ``gain`` is given: the task, and metrics whose mean is compared.
COMPARED = {
    "E_r": ("retargeting", ("E_r_first", "E_r_second")),
    "JPD": ("retargeting", ("JPD",)),
    "JPD_sampled": ("generation", ("JPD",)),  # on bodies that the model samples
}
MODEL = "kinematic"  # which adds to the start
Sources = dict[str, dict[str, float]]


@dataclass(frozen=True)
class Params:
    """The ``pool_skeleton_prior`` section of ``params.yaml``."""

    confidence: float


def main(priors_folder: Path, pooled_file: Path) -> None:
    params = read_params("pool_skeleton_prior", Params)
    rows: dict[str, Any] = {task: {} for task in TASKS}
    data_facts: dict[str, Any] = {}
    gains: dict[str, Any] = {}
    for (dataset, split), folds in folds_of_groups(read_prior_runs()).items():
        files = [priors_folder / "scores" / dataset / f"{fold}.json" for fold in folds]
        scores = join_folds([read_json(file) for file in files])
        data_facts.setdefault(dataset, {})[split] = {
            name: scores[name] for name in ("extractor", "train", "tested", "bodies")
        } | {"folds": folds}
        for task in TASKS:
            pooled = {
                model: over_units(
                    [scores_of_seed[task] for scores_of_seed in seeds.values()], params.confidence
                )
                for model, seeds in scores["models"].items()
            }
            rows[task].setdefault(dataset, {})[split] = pooled
        if MODEL in scores["models"]:
            gain = gain_over_start(scores["models"], params.confidence)
            gain |= {"confidence": params.confidence, "weights": scores["weights"]}
            gains.setdefault(dataset, {})[split] = gain
    write_json(pooled_file, {**rows, "gain": gains, "data_facts": data_facts})


def folds_of_groups(runs: PriorRuns) -> dict[tuple[str, str], list[str]]:
    """List the folds of each dataset and split; a split without folds is its own."""
    folds: dict[tuple[str, str], list[str]] = {}
    for dataset, name in runs.groups():
        folds.setdefault((dataset, parse_split_name(name).pooled), []).append(name)
    return folds


def join_folds(folds: list[dict[str, Any]]) -> dict[str, Any]:
    """Join scores of folds, of which each tests other sources; ``train`` is their mean.

    ``weights`` are the hashes of the weights of ``MODEL``.
    """
    joined: dict[str, Any] = {
        "extractor": folds[0]["extractor"],
        "train": round(sum(fold["train"] for fold in folds) / len(folds)),
        "tested": sum(fold["tested"] for fold in folds),
        "bodies": folds[0]["bodies"],
        "weights": [h for fold in folds for h in fold["weights"].get(MODEL, {}).values()],
        "models": {},
    }
    for fold in folds:
        for model, seeds in fold["models"].items():
            for seed, tasks in seeds.items():
                for task, sources in tasks.items():
                    scores = joined["models"].setdefault(model, {}).setdefault(seed, {})
                    scores.setdefault(task, {}).update(sources)
    return joined


def over_units(seeds: list[Sources], confidence: float) -> dict[str, Any]:
    """Pool each source's metrics: by source, by metric, mean, low and high."""
    sources = [source for source in seeds[0] if source != ALL_SOURCES]
    pooled: dict[str, Any] = {}
    for source, metrics in seeds[0].items():
        rows = sources if source == ALL_SOURCES else [source]
        pooled[source] = {}
        for metric in metrics:
            having = [row for row in rows if metric in seeds[0][row]]
            values = [[scores[row][metric] for scores in seeds] for row in having]
            pooled[source][metric] = interval(np.array(values), confidence)
    return pooled


def gain_over_start(models: dict[str, Any], confidence: float) -> dict[str, Any]:
    """Compute by how much training lowers the start's errors, and the numbers of units.

    Returns
    -------
    ``motions`` and ``seeds``; of each of ``COMPARED`` the interval of the share, and the mean
    errors of the ``start`` and of the ``trained`` model, metres. Of those on sampled bodies the
    motions are the ones of which the solver's variations of such bodies are accepted
    """
    start, *_ = models[START].values()
    trained = list(models[MODEL].values())
    motions = [source for source in start["retargeting"] if source != ALL_SOURCES]
    gains: dict[str, Any] = {"motions": len(motions), "seeds": len(trained)}
    for name, (task, metrics) in COMPARED.items():
        rows = start[task]
        tested = [source for source in motions if set(metrics) <= rows.get(source, {}).keys()]
        if not tested:
            continue
        before = np.array([[error(rows[source], metrics)] for source in tested])
        after = np.array([[error(s[task][source], metrics) for s in trained] for source in tested])
        gains[name] = interval(1 - after / before, confidence)
        for row, errors in (("start", before), ("trained", after)):
            gains[name][row] = float(f"{errors.mean():.6g}")
    return gains


def error(scores: dict[str, float], metrics: tuple[str, ...]) -> float:
    """Average metrics of one motion."""
    return sum(scores[metric] for metric in metrics) / len(metrics)


def interval(values: NDArray[np.float64], confidence: float) -> dict[str, float]:
    """Give the mean of values (motions, seeds) and its interval; of one value the mean alone."""
    mean, variance, fewest = float(np.mean(values)), 0.0, np.inf
    for axis in (0, 1):
        means = values.mean(axis=1 - axis)
        if len(means) > 1:
            variance += float(np.var(means, ddof=1)) / len(means)
            fewest = min(fewest, len(means))
    bounds = {"mean": mean}
    if np.isfinite(fewest):
        half_width = variance**0.5 * float(student.ppf((1 + confidence) / 2, fewest - 1))
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
