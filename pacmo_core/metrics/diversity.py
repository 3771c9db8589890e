"""Diversity of features, and matching accuracy (R-precision) of reactions and partners."""

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

from pacmo_core.metrics.f2id import Array, flatten
from pacmo_core.metrics.mmd import squared_distances


def feature_distances(features: Array, weights: Array, *, squared: bool) -> Array:
    """Return the L²(time) distances, or their squares, of all pairs of features.

    Parameters
    ----------
    features : (n, C, r)
    weights : (r,) quadrature weights, sum 1

    Returns
    -------
    (n, n)
    """
    vectors = flatten(features, weights)
    distances = squared_distances(vectors, vectors)
    return distances if squared else np.sqrt(distances)


def disjoint_pair_mean(
    distances: Array, samples: np.ndarray[tuple[int], np.dtype[np.intp]]
) -> float:
    """Return the mean distance between samples of the first and of the second half of a replicate.

    Parameters
    ----------
    distances : (n, n)
    samples : (2k,) int, below n, in random order
    """
    half = len(samples) // 2
    if half < 1:
        raise ValueError(f"wanted at least 2 samples to pair; got {len(samples)}")
    return float(distances[samples[:half], samples[half : 2 * half]].mean())


def diversity(
    features: Array, weights: Array, *, squared: bool, generator: np.random.Generator
) -> float:
    """Return the mean distance over random disjoint pairs of samples (PaCMO, section 4.3.1).

    The paper squares the distance, whose population value is then 2 Tr K; most other work does not.

    Parameters
    ----------
    features : (n, C, r)
    weights : (r,) quadrature weights, sum 1
    squared : as in the paper
    generator : for the pairs
    """
    distances = feature_distances(features, weights, squared=squared)
    return disjoint_pair_mean(distances, generator.permutation(len(features)))


Codes = NDArray[np.intp]


def matching_accuracy(embedded: Array, codes: Codes, counts: Array, *, candidates: int) -> Array:
    """Return the share of reactions whose true partner fits best among the candidates.

    The other candidates are partners of other clips. The expectation over their random choice is
    computed in closed form: if w of K of them fit at least as well as the true partner, m drawn
    without replacement are all worse with probability C(K − w, m) / C(K, m). (R-precision of Guo et
    al. 2022, *Generating diverse and natural 3D human motions from text*, draws 31 at random.)

    Parameters
    ----------
    embedded : (2, n, E), of partners and reactions; reaction i is to partner i
    codes : (n,) int, the column of ``counts`` of each partner's clip
    counts : (B, G) integers, the count of each clip in each replicate; copies of a clip
        compete with other clips, not with each other
    candidates : including the true partner; fewer if a replicate has fewer

    Returns
    -------
    (B,)
    """
    fit = embedded[1] @ embedded[0].T  # (reactions, partners)
    foreign = codes[:, None] != codes
    better = foreign & (fit >= np.diag(fit)[:, None])
    weights = counts[:, codes]
    others, n_better = weights @ foreign.T, weights @ better.T
    n_drawn = np.minimum(candidates - 1, others)
    picked = np.exp(_log_binomial(others - n_better, n_drawn) - _log_binomial(others, n_drawn))
    return np.asarray((weights * picked).sum(axis=1) / weights.sum(axis=1))


def n_candidates(codes: Codes, maximum: int) -> int:
    """Return the number of candidates: at most ``maximum``, and at most what every clip has."""
    return min(maximum, 1 + int((codes[:, None] != codes).sum(axis=1).min()))


def _log_binomial(n: Array, k: Array) -> Array:
    """Return the logarithm of the binomial coefficient; −∞ if it is zero."""
    possible = n >= k
    safe = np.where(possible, n, k)
    log_ways = gammaln(safe + 1) - gammaln(k + 1) - gammaln(safe - k + 1)
    return np.where(possible, log_ways, -np.inf)
