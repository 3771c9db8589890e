"""Diversity: how far apart the features of different motions lie."""

import numpy as np

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


def disjoint_pair_mean(distances: Array, drawn: np.ndarray[tuple[int], np.dtype[np.intp]]) -> float:
    """Average the distance from each sample of the first half of a draw to one of the second.

    Parameters
    ----------
    distances : (n, n)
    drawn : (2k,) int, below n, in random order
    """
    half = len(drawn) // 2
    if half < 1:
        raise ValueError(f"wanted at least 2 samples to pair; got {len(drawn)}")
    return float(distances[drawn[:half], drawn[half : 2 * half]].mean())


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
