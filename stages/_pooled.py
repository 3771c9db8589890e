"""What pooling says of PaCMO trained with variations and without; figures as JSON has them."""

from typing import Any

from pacmo_core.metrics.intervals import Estimate, difference
from pacmo_core.metrics.paired import fold_differences, mean_of_folds
from pacmo_core.metrics.pooling import BySeed

PLAIN, AUGMENTED = "pacmo", "pacmo_augmented"

Folds = dict[str, dict[str, list[BySeed]]]  # row, metric, then fold by fold


def augmentation(
    table: Folds, pooled: dict[str, dict[str, Estimate]], confidence: float
) -> dict[str, Any]:
    """Compare PaCMO trained with variations and without, fold by fold; nothing without both."""
    if AUGMENTED not in table or PLAIN not in table:
        return {}
    with_, without = table[AUGMENTED], table[PLAIN]
    both = [metric for metric in pooled[AUGMENTED] if metric in pooled[PLAIN]]
    each = {metric: fold_differences(with_[metric], without[metric]) for metric in both}
    means = {name: mean_of_folds(found, confidence) for name, found in each.items()}
    return {
        "each": {name: [float(f"{x:.6g}") for x in found] for name, found in each.items()},
        "folds": as_json({name: found for name, found in means.items() if found is not None}),
        "clips": as_json(
            {
                name: difference(pooled[AUGMENTED][name], pooled[PLAIN][name], confidence)
                for name in both
            }
        ),
    }


def as_json(metrics: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Round to what the intervals support, so that equal figures read equal."""
    return {
        name: {
            part: value if isinstance(value, bool) else float(f"{value:.6g}")
            for part, value in vars(found).items()
        }
        for name, found in metrics.items()
    }
