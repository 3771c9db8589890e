"""Pool the scores of all folds and seeds into the table, with intervals and paired differences.

Usage: python -m stages.pool_pacmo --scores DIR --pooled JSON
"""

import argparse
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from pacmo_core.metrics.bootstrap import (
    BySeed,
    Estimate,
    difference,
    fold_differences,
    fold_mean_interval,
    is_repeated_metric,
    pool_folds,
    pooled_interval,
)
from pacmo_core.metrics.catalogue import BASELINES, MODELS
from pacmo_core.metrics.controls import EXACT_FOR_REAL, sensitivity
from pacmo_core.store.scores import read_scores
from stages.common.files import write_json
from stages.common.params import read_params, run_stage

WITHOUT, WITH = "pacmo", "pacmo_augmented"

Folds = dict[str, dict[str, list[BySeed]]]  # by row and metric, a list of folds


def augmentation_effect(
    table: Folds, pooled: dict[str, dict[str, Estimate]], confidence: float
) -> dict[str, Any]:
    """Compare PaCMO trained with and without variations; empty if either is missing."""
    if WITH not in table or WITHOUT not in table:
        return {}
    with_variations, without_variations = table[WITH], table[WITHOUT]
    both = [metric for metric in pooled[WITH] if metric in pooled[WITHOUT]]
    each = {
        metric: fold_differences(with_variations[metric], without_variations[metric])
        for metric in both
    }
    means = {name: fold_mean_interval(result, confidence) for name, result in each.items()}
    return {
        "each": {name: [float(f"{x:.6g}") for x in result] for name, result in each.items()},
        "folds": round_estimates(
            {name: result for name, result in means.items() if result is not None}
        ),
        "clips": round_estimates(
            {
                name: difference(pooled[WITH][name], pooled[WITHOUT][name], confidence)
                for name in both
            }
        ),
    }


def round_estimates(metrics: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Round to six significant digits; leave out the bounds of what has no interval."""
    return {
        name: {
            part: value if isinstance(value, bool) else float(f"{value:.6g}")
            for part, value in vars(result).items()
            if not np.isnan(value)
        }
        for name, result in metrics.items()
    }


# The row from which the other models are subtracted.
REFERENCE_ROW = "pacmo"
REAL = "real"
NOISE_FLOORS = {"f2id_floor": "f2id", "f2id_halves": "f2id_halves"}
# Beginnings of the names of rows that are not models.
NON_MODEL_ROWS = ("real", "wrong_partner")
SAME_ACTION = "_same_action"
PERMUTATION_PAIRS = {
    "any_action": ("real_pairs", "wrong_partner"),
    "same_action": ("real_pairs_same_action", "wrong_partner_same_action"),
    "pacmo_any_action": ("pacmo", "pacmo_permuted"),
    "pacmo_same_action": ("pacmo_same_action", "pacmo_permuted_same_action"),
}


@dataclass(frozen=True)
class Params:
    """The ``pool_pacmo`` section of ``params.yaml``."""

    confidence: float
    random_seed: int


def main(scores: Path, pooled_file: Path) -> None:
    params = read_params("pool_pacmo", Params)
    files = sorted(scores.glob("*.parquet"))
    if not files:
        raise ValueError(f"{scores}: wanted FOLD.parquet in it, found none")
    facts = {file.stem: read_scores(file)[1] for file in files}
    folds = {file.stem: read_fold(file) for file in files}
    table = align_folds(list(folds.values()))
    pooled = {row: pooled_row(result, params) for row, result in table.items()}
    write_json(
        pooled_file,
        {
            "folds": list(folds),
            "seeds": {row: seeds_of(result) for row, result in table.items()},
            "confidence": params.confidence,
            "extractor_sha256": {fold: f["autoencoder_sha256"] for fold, f in facts.items()},
            "matcher_sha256": {fold: f["matcher_sha256"] for fold, f in facts.items()},
            "test_reactions": sum(f["n"]["test_reactions"] for f in facts.values()),
            "unit": {fold: f["unit"] for fold, f in facts.items()},
            "n": {fold: f["n"] for fold, f in facts.items()},
            "rows": add_noise_floors(
                {row: intervals(result, params) for row, result in table.items()}
            ),
            "absent": collect_missing(facts),
            "differences": differences(pooled, params.confidence),
            "sensitivity": sensitivities(pooled, params.confidence),
            "augmentation": augmentation_effect(table, pooled, params.confidence),
        },
    )


def read_fold(file: Path) -> dict[str, dict[str, dict[int, Estimate]]]:
    """Read one fold: row, metric, seed."""
    result: dict[str, dict[str, dict[int, Estimate]]] = {}
    for score in read_scores(file)[0]:
        seeds = result.setdefault(score.row, {}).setdefault(score.metric, {})
        seeds[score.seed] = Estimate(float(score.values[0]), score.values[1:])
    return result


def align_folds(folds: list[dict[str, dict[str, dict[int, Estimate]]]]) -> Folds:
    """List each metric of each row by fold; drop those that a fold or a seed lacks.

    Rows of clips of one action are lacking where no action has several.

    Raises
    ------
    ValueError
        If PaCMO was trained with variations in some folds only: it would vanish from the tables.
    """
    first = folds[0]
    n_augmented = sum(WITH in fold for fold in folds)
    if 0 < n_augmented < len(folds):
        raise ValueError(
            f"augmented.folds: wanted all {len(folds)} folds of runs.folds, or none; got "
            f"{n_augmented}"
        )
    return {
        row: {
            metric: [fold[row][metric] for fold in folds]
            for metric in metrics
            if all(has_all_seeds(fold.get(row, {}), metric) for fold in folds)
        }
        for row, metrics in first.items()
        if all(row in fold for fold in folds)
    }


def has_all_seeds(metrics: dict[str, dict[int, Estimate]], metric: str) -> bool:
    """Return whether a row has a metric for each of its seeds."""
    seeds = {seed for result in metrics.values() for seed in result}
    return metrics.get(metric, {}).keys() == seeds


def seeds_of(metrics: dict[str, list[BySeed]]) -> list[int]:
    """List the seeds of a row."""
    return sorted({seed for folds in metrics.values() for fold in folds for seed in fold})


def pooled_row(metrics: dict[str, list[BySeed]], params: Params) -> dict[str, Estimate]:
    """Pool the metrics that have bootstrap replicates."""
    return {
        metric: pool_folds(folds, params.random_seed)
        for metric, folds in metrics.items()
        if not is_repeated_metric(metric)
    }


def intervals(metrics: dict[str, list[BySeed]], params: Params) -> dict[str, dict[str, float]]:
    """Return each metric of a row with its interval."""
    return round_estimates(
        {
            metric: pooled_interval(metric, folds, params.random_seed, params.confidence)
            for metric, folds in metrics.items()
        }
    )


def add_noise_floors(rows: dict[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """Add the noise floors, metrics of the row ``real``, to every row."""
    floors = {name: rows[REAL][metric] for name, metric in NOISE_FLOORS.items()}
    return {row: metrics | floors for row, metrics in rows.items()}


def differences(pooled: dict[str, dict[str, Estimate]], confidence: float) -> dict[str, Any]:
    """Subtract by replicate: others from PaCMO, baselines from models, wrong partners from true."""
    others = [
        row for row in pooled if not row.startswith(NON_MODEL_ROWS) and SAME_ACTION not in row
    ]
    pairs = [(REFERENCE_ROW, row) for row in others if row != REFERENCE_ROW]
    for first, second in (*product(MODELS, BASELINES), *PERMUTATION_PAIRS.values()):
        if first != second and not {(first, second), (second, first)} & set(pairs):
            pairs.append((first, second))
    return {
        f"{first}_minus_{second}": round_estimates(
            {
                metric: difference(estimate, pooled[second][metric], confidence)
                for metric, estimate in pooled[first].items()
                if metric in pooled[second]
            }
        )
        for first, second in pairs
        if first in pooled and second in pooled
    }


def sensitivities(pooled: dict[str, dict[str, Estimate]], confidence: float) -> dict[str, Any]:
    """Return for each metric whether it distinguishes true pairs from permuted ones."""
    return {
        name: round_estimates(
            sensitivity(
                pooled[true],
                pooled[permuted],
                confidence,
                left_out=EXACT_FOR_REAL if true.startswith(REAL) else frozenset(),
            )
        )
        for name, (true, permuted) in PERMUTATION_PAIRS.items()
        if true in pooled and permuted in pooled
    }


def collect_missing(facts: dict[str, dict[str, Any]]) -> dict[str, dict[str, str]]:
    """Merge the reasons of all folds."""
    result: dict[str, dict[str, str]] = {}
    for fold in facts.values():
        for row, reasons in fold["absent"].items():
            result.setdefault(row, {}).update(reasons)
    return result


def arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser()
    for name in ("scores", "pooled"):
        parser.add_argument(f"--{name}", type=Path, required=True)
    return parser.parse_args()


if __name__ == "__main__":
    parsed = arguments()
    run_stage(main, parsed.scores, parsed.pooled)
