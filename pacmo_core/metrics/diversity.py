"""Diversity of features, and matching: how often the true partner is picked among candidates."""

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

from pacmo_core.metrics.f2id import Array, flatten
from pacmo_core.metrics.mmd import squared_distances


def feature_distances(features: Array, weights: Array, *, squared: bool) -> Array:
    """Measure the L²(time) distance, or its square, of all pairs of features.

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
    """Average the distance from each sample of the first half of a replicate to one of the second.

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
    """Average the distance over random disjoint pairs, each sample in at most one (section 4.3.1).

    The paper squares the distance, and its population value is then 2 Tr K; the field at large
    does not square.

    Parameters
    ----------
    features : (n, C, r)
    weights : (r,) quadrature weights, sum 1
    squared : as the paper, or not
    generator : deals the pairs
    """
    distances = feature_distances(features, weights, squared=squared)
    return disjoint_pair_mean(distances, generator.permutation(len(features)))


Codes = NDArray[np.intp]


def matching_accuracy(embedded: Array, codes: Codes, counts: Array, *, candidates: int) -> Array:
    """Give the share of reactions whose true partner fits best among so many candidates.

    The rivals are partners of other clips. What a random choice of them gives is worked out, not
    samples: where w of K rivals fit at least as well as the true partner, m of them samples without
    replacement are all worse with probability C(K − w, m) / C(K, m). (R-precision of Guo et al.
    2022, *Generating diverse and natural 3D human motions from text*, replicates 31 at random.)

    Parameters
    ----------
    embedded : (2, n, E), of partners and reactions; reaction i stands before partner i
    codes : (n,) int, the column of ``counts`` of each partner's clip
    counts : (B, G) integers, the count of each clip in each replicate; copies of a clip
        are rivals of other clips, not of each other
    candidates : the true partner and its rivals; fewer where a replicate holds fewer

    Returns
    -------
    (B,)
    """
    fit = embedded[1] @ embedded[0].T  # (reactions, partners)
    foreign = codes[:, None] != codes
    better = foreign & (fit >= np.diag(fit)[:, None])
    weights = counts[:, codes]
    rivals, ahead = weights @ foreign.T, weights @ better.T
    asked = np.minimum(candidates - 1, rivals)
    picked = np.exp(_log_binomial(rivals - ahead, asked) - _log_binomial(rivals, asked))
    return np.asarray((weights * picked).sum(axis=1) / weights.sum(axis=1))


def n_candidates(codes: Codes, wanted: int) -> int:
    """Count the candidates: as many as wanted, or one more than the fewest rivals."""
    return min(wanted, 1 + int((codes[:, None] != codes).sum(axis=1).min()))


def _log_binomial(n: Array, k: Array) -> Array:
    """Logarithm of the ways to choose k of n; of none, −∞."""
    possible = n >= k
    safe = np.where(possible, n, k)
    ways = gammaln(safe + 1) - gammaln(k + 1) - gammaln(safe - k + 1)
    return np.where(possible, ways, -np.inf)
