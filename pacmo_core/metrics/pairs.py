"""Means over pairs of samples that come from different clips."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Codes = NDArray[np.intp]


def pair_means(values: Array, rows: Codes, columns: Codes, counts: Array) -> Array:
    """Average a function of two samples over all pairs from different clips.

    A clip that a bootstrap drew c times counts c times, but never against its own copies: so the
    mean over many draws is that of the data, and no copy makes two samples look alike.

    Parameters
    ----------
    values : (n, m), the function for each pair
    rows, columns : (n,), (m,) int, the clip of each sample, below G
    counts : (B, G), how often each of B draws took each clip

    Returns
    -------
    (B,)

    Raises
    ------
    ValueError
        If a draw leaves no pair from different clips.
    """
    sums = _clip_sums(values, rows, columns, counts.shape[1])
    numbers = _clip_sums(np.ones_like(values), rows, columns, counts.shape[1])
    total = ((counts @ sums) * counts).sum(axis=1)
    number = ((counts @ numbers) * counts).sum(axis=1)
    if (number <= 0).any():
        raise ValueError("wanted samples from at least two clips; a draw has only one")
    return np.asarray(total / number)


def _clip_sums(values: Array, rows: Codes, columns: Codes, n_clips: int) -> Array:
    """Sum values over the samples of each pair of clips, (G, G), zero within a clip."""
    clips = np.arange(n_clips)
    sums = (rows == clips[:, None]).astype(float) @ values @ (columns[:, None] == clips)
    np.fill_diagonal(sums, 0.0)
    return np.asarray(sums)
