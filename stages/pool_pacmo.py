"""Pool the scores of all folds and seeds into the table, with intervals and paired differences.

Usage: python -m stages.pool_pacmo --scores DIR --metrics JSON
"""

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pacmo_core.metrics.intervals import Estimate, difference
from pacmo_core.metrics.pooling import BySeed, is_repeated, pool, pooled_interval
from pacmo_core.metrics.sensitivity import PERFECT, sensitivity
from pacmo_core.store.scores import read_scores
from stages._files import write_json
from stages._params import read_params
from stages._pooled import Folds, as_json, augmentation

# Of these all other models of reactions are subtracted.
FIRST = "pacmo"
REAL = "real"
FLOORS = {"f2id_floor": "f2id", "f2id_halves": "f2id_halves"}
# Rows that are no other model's: real motion, and what is dealt to wrong partners.
NO_MODEL = ("real", "wrong_partner")
SAME_ACT = "_same_act"
SEEN = {
    "any_act": ("real_pairs", "wrong_partner"),
    "same_act": ("real_pairs_same_act", "wrong_partner_same_act"),
    "pacmo_any_act": ("pacmo", "pacmo_permuted"),
    "pacmo_same_act": ("pacmo_same_act", "pacmo_permuted_same_act"),
}


@dataclass(frozen=True)
class Params:
    """The ``pool_pacmo`` section of ``params.yaml``."""

    confidence: float
    random_seed: int


def main(scores: Path, metrics: Path) -> None:
    params = read_params("pool_pacmo", Params)
    files = sorted(scores.glob("*.parquet"))
    if not files:
        raise ValueError(f"{scores}: wanted FOLD.parquet in it, found none")
    facts = {file.stem: read_scores(file)[1] for file in files}
    folds = {file.stem: by_row(file) for file in files}
    table = in_every_fold(list(folds.values()))
    pooled = {row: pooled_row(found, params) for row, found in table.items()}
    write_json(
        metrics,
        {
            "folds": list(folds),
            "seeds": {row: seeds_of(found) for row, found in table.items()},
            "confidence": params.confidence,
            "extractor_sha256": {fold: f["autoencoder_sha256"] for fold, f in facts.items()},
            "matcher_sha256": {fold: f["matcher_sha256"] for fold, f in facts.items()},
            "test_reactions": sum(f["n"]["test_reactions"] for f in facts.values()),
            "n": {fold: f["n"] for fold, f in facts.items()},
            "rows": with_floors({row: intervals(found, params) for row, found in table.items()}),
            "absent": absences(facts),
            "differences": differences(pooled, params.confidence),
            "sensitivity": sensitivities(pooled, params.confidence),
            "augmentation": augmentation(table, pooled, params.confidence),
        },
    )


def by_row(file: Path) -> dict[str, dict[str, dict[int, Estimate]]]:
    """Read one fold: row, metric, seed."""
    found: dict[str, dict[str, dict[int, Estimate]]] = {}
    for score in read_scores(file)[0]:
        seeds = found.setdefault(score.row, {}).setdefault(score.metric, {})
        seeds[score.seed] = Estimate(float(score.values[0]), score.values[1:])
    return found


def in_every_fold(folds: list[dict[str, dict[str, dict[int, Estimate]]]]) -> Folds:
    """Line up the folds, and leave out what one of them, or one of a row's seeds, is without."""
    first = folds[0]
    return {
        row: {
            metric: [fold[row][metric] for fold in folds]
            for metric in metrics
            if all(is_whole(fold.get(row, {}), metric) for fold in folds)
        }
        for row, metrics in first.items()
        if all(row in fold for fold in folds)
    }


def is_whole(metrics: dict[str, dict[int, Estimate]], metric: str) -> bool:
    """Tell whether a row has a metric for each of its seeds."""
    seeds = {seed for found in metrics.values() for seed in found}
    return metrics.get(metric, {}).keys() == seeds


def seeds_of(metrics: dict[str, list[BySeed]]) -> list[int]:
    """List the seeds of a row."""
    return sorted({seed for folds in metrics.values() for fold in folds for seed in fold})


def pooled_row(metrics: dict[str, list[BySeed]], params: Params) -> dict[str, Estimate]:
    """Pool what can be compared draw by draw."""
    return {
        metric: pool(folds, params.random_seed)
        for metric, folds in metrics.items()
        if not is_repeated(metric)
    }


def intervals(metrics: dict[str, list[BySeed]], params: Params) -> dict[str, dict[str, float]]:
    """Give each metric of a row with its bounds."""
    return as_json(
        {
            metric: pooled_interval(metric, folds, params.random_seed, params.confidence)
            for metric, folds in metrics.items()
        }
    )


def with_floors(rows: dict[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """Set the floors, which are the row ``real``'s, beside every row's metrics."""
    floors = {name: rows[REAL][metric] for name, metric in FLOORS.items()}
    return {row: metrics | floors for row, metrics in rows.items()}


def differences(pooled: dict[str, dict[str, Estimate]], confidence: float) -> dict[str, Any]:
    """Subtract every other model from PaCMO, and wrong partners from right ones, draw by draw."""
    others = [row for row in pooled if not row.startswith(NO_MODEL) and SAME_ACT not in row]
    pairs = [(FIRST, row) for row in others if row != FIRST]
    pairs += [pair for pair in SEEN.values() if pair not in pairs]
    return {
        f"{first}_minus_{second}": as_json(
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
    """Say of each metric whether it tells true pairs from those dealt to wrong partners."""
    return {
        name: as_json(
            sensitivity(
                pooled[true],
                pooled[dealt],
                confidence,
                left_out=PERFECT if true.startswith(REAL) else frozenset(),
            )
        )
        for name, (true, dealt) in SEEN.items()
        if true in pooled and dealt in pooled
    }


def absences(facts: dict[str, dict[str, Any]]) -> dict[str, dict[str, str]]:
    """Gather the reasons of all folds."""
    found: dict[str, dict[str, str]] = {}
    for fold in facts.values():
        for row, reasons in fold["absent"].items():
            found.setdefault(row, {}).update(reasons)
    return found


def arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser()
    for name in ("scores", "metrics"):
        parser.add_argument(f"--{name}", type=Path, required=True)
    return parser.parse_args()


if __name__ == "__main__":
    parsed = arguments()
    main(parsed.scores, parsed.metrics)
