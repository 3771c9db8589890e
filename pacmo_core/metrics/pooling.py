"""One figure from several seeds and folds: means of means, and draws that resample seeds too.

Within a fold a draw takes the metric on that draw of clips, averaged over as many seeds as there
are, drawn with replacement; draws of different folds are independent, so the k-th of each are
averaged. All rows share the draws of clips and of seeds: two rows may be compared draw by draw.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from pacmo_core.metrics.intervals import Array, Estimate, Interval, interval, repeated

# These cannot fall below zero; the unbiased MMD, an excess and an extrapolation can.
NOT_NEGATIVE = (
    *("f2id", "f2id_floor", "f2id_distances", "diversity", "diversity_l2"),
    *("ape", "ave", "ape_joints", "ave_joints"),
    *("matching", "foot_sliding", "penetration", "contact_agreement", "multimodality"),
)

BySeed = Mapping[int, Estimate]


def pool(folds: Sequence[BySeed], random_seed: int) -> Estimate:
    """Pool one metric of one row.

    Parameters
    ----------
    folds : of each fold, the metric by seed; all with the same number of draws
    random_seed : for the draws of seeds; one number for all that is to be compared

    Raises
    ------
    ValueError
        If there is nothing to pool, or the numbers of draws differ.
    """
    lengths = {len(estimate.resampled) for fold in folds for estimate in fold.values()}
    if len(lengths) != 1 or not all(folds):
        raise ValueError(f"wanted estimates of one number of draws in every fold; got {lengths}")
    plain = np.mean([np.mean([e.plain for e in fold.values()]) for fold in folds])
    draws = [_over_seeds(fold, (random_seed, k)) for k, fold in enumerate(folds)]
    return Estimate(float(plain), np.mean(draws, axis=0))


def pooled_interval(
    metric: str, folds: Sequence[BySeed], random_seed: int, confidence: float
) -> Interval:
    """Give a metric's interval, or of the paper's protocol the mean and the range of repeats."""
    if is_repeated(metric):
        every = [e.resampled for fold in folds for e in fold.values()]
        means = [np.mean([e.resampled.mean() for e in fold.values()]) for fold in folds]
        found = repeated(np.concatenate(every))
        return Interval(float(np.mean(means)), found.low, found.high)
    least = 0.0 if metric in NOT_NEGATIVE else -np.inf
    return interval(pool(folds, random_seed), confidence, least=least)


def is_repeated(metric: str) -> bool:
    """Tell whether a metric's draws are repeats of a protocol, not draws of clips."""
    return metric.endswith("_published") or metric == "f2id_halves"


def _over_seeds(fold: BySeed, entropy: tuple[int, int]) -> Array:
    values = np.stack([fold[seed].resampled for seed in sorted(fold)])  # (S, B)
    generator = np.random.default_rng(entropy)
    chosen = generator.integers(len(values), size=values.shape)
    return np.asarray(np.take_along_axis(values, chosen, axis=0).mean(axis=0))
