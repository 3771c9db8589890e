"""Two ways to train, run for run: what one gains on the same fold from the same seed.

The bootstrap's intervals say how far figures may lie because clips are few; these say how far
because trainings are few, and people are others in every fold.
"""

from collections.abc import Sequence

import numpy as np
from scipy.stats import t as student

from pacmo_core.metrics.intervals import Array, Interval
from pacmo_core.metrics.pooling import BySeed


def fold_differences(first: Sequence[BySeed], second: Sequence[BySeed]) -> Array:
    """``(F,)``: the mean difference of the runs of each fold, by the seeds that both have.

    Parameters
    ----------
    first, second : of each fold, a metric by seed

    Raises
    ------
    ValueError
        If they have no seed in common in a fold, or not the same folds.
    """
    found = []
    for one, other in zip(first, second, strict=True):
        seeds = sorted(one.keys() & other.keys())
        if not seeds:
            raise ValueError(f"wanted a seed in common, got {sorted(one)} and {sorted(other)}")
        found.append(np.mean([one[seed].plain - other[seed].plain for seed in seeds]))
    return np.array(found)


def mean_of_folds(differences: Array, confidence: float) -> Interval | None:
    """Give the mean and Student's interval, each fold one draw; nothing for a single fold.

    Folds share training clips, so that the interval is somewhat too narrow (Nadeau and Bengio
    2003, *Inference for the generalization error*).
    """
    n = len(differences)
    if n < 2:
        return None
    mean = float(differences.mean())
    half = float(student.ppf((1 + confidence) / 2, n - 1) * differences.std(ddof=1) / np.sqrt(n))
    return Interval(mean, mean - half, mean + half)
