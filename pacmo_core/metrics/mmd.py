"""Maximum mean discrepancy between motions, by frame (A) and by whole sequence (S).

Unbiased estimates use pairs of samples from different clips (``pair_means``); the published ones
follow the paper's protocol.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Codes = NDArray[np.intp]


def pair_means(values: Array, rows: Codes, columns: Codes, counts: Array) -> Array:
    """Return the mean of a function of two samples over all pairs from different clips.

    A clip with count c in a replicate counts c times, but not with its own copies: copies would
    make samples look alike, and bias the mean over replicates.

    Parameters
    ----------
    values : (n, m), the function for each pair
    rows, columns : (n,), (m,) int, the clip of each sample, below G
    counts : (B, G), the count of each clip in each of B replicates

    Returns
    -------
    (B,)

    Raises
    ------
    ValueError
        If a replicate has no pair from different clips.
    """
    sums = _clip_sums(values, rows, columns, counts.shape[1])
    numbers = _clip_sums(np.ones_like(values), rows, columns, counts.shape[1])
    total = ((counts @ sums) * counts).sum(axis=1)
    number = ((counts @ numbers) * counts).sum(axis=1)
    if (number <= 0).any():
        raise ValueError("wanted samples from at least two clips; a replicate has only one")
    return np.asarray(total / number)


def _clip_sums(values: Array, rows: Codes, columns: Codes, n_clips: int) -> Array:
    """Sum values over the samples of each pair of clips, (G, G), zero within a clip."""
    clips = np.arange(n_clips)
    sums = (rows == clips[:, None]).astype(float) @ values @ (columns[:, None] == clips)
    np.fill_diagonal(sums, 0.0)
    return np.asarray(sums)


# The 14 bandwidths of MUGL.
PUBLISHED_BANDWIDTHS: Array = 10.0 ** np.arange(-4, 10, dtype=np.float64)


def mean_kernels(x: Array, y: Array, bandwidths: Array) -> Array:
    """Return the Gaussian kernel of every pair of motions, averaged over frames.

    Parameters
    ----------
    x, y : (n, T, D), (m, T, D)
    bandwidths : (K,) in the squared unit of the motions

    Returns
    -------
    (K, n, m)
    """
    if x.ndim != 3 or y.ndim != 3 or x.shape[1:] != y.shape[1:]:
        raise ValueError(f"motions must be (n, T, D) and (m, T, D); got {x.shape}, {y.shape}")
    total = np.zeros((len(bandwidths), len(x), len(y)))
    for frame in range(x.shape[1]):
        squared = squared_distances(x[:, frame], y[:, frame])
        for kernel, bandwidth in zip(total, bandwidths, strict=True):
            kernel += np.exp(squared / -bandwidth)
    return np.asarray(total / x.shape[1])


def squared_distances(x: Array, y: Array) -> Array:
    """Return |x − y|² for all pairs of (n, D) and (m, D), by the Gram identity.

    The mean of ``x`` is subtracted first, since a common offset costs digits.
    """
    x, y = x - x.mean(axis=0), y - x.mean(axis=0)
    squared = (x**2).sum(axis=1)[:, None] + (y**2).sum(axis=1) - 2 * x @ y.T
    # Round-off between equal vectors is about 1e-12 m² for whole sequences; the smallest published
    # bandwidth is 1e-4.
    return np.asarray(np.maximum(squared, 0.0))


def median_bandwidth(real: Array) -> float:
    """Return b = 2 · median |x − x′|² over pairs of real motions, averaged over frames.

    Gretton et al. (2012) pool both sets; here real motion alone determines the kernel, so that
    it is the same for every row of a table.

    Parameters
    ----------
    real : (n, T, D)
    """
    upper = np.triu_indices(len(real), k=1)
    frames = range(real.shape[1])
    medians = [np.median(squared_distances(real[:, t], real[:, t])[upper]) for t in frames]
    bandwidth = 2 * float(np.mean(medians))
    if not bandwidth > 0:
        raise ValueError(f"at least half of {len(real)} real motions are alike: no bandwidth")
    return bandwidth


def as_sequence(motions: Array) -> Array:
    """Reshape (n, T, D) motions to (n, 1, T·D): MMD-S is the MMD-A of these."""
    return motions.reshape(len(motions), 1, -1)


def mmd_a(x: Array, y: Array, x_clips: Codes, y_clips: Codes, *, bandwidth: float) -> float:
    """Return the unbiased estimate of the squared MMD of two sets of motions, frame by frame.

    The means are over pairs from different clips only (Gretton et al. 2012, equation 4, where
    i ≠ j): two people of one clip, or a reaction and the real one to the same partner, depend on
    each other. May be negative; a set against itself gives 0.

    Parameters
    ----------
    x, y : (n, T, D), (m, T, D)
    x_clips, y_clips : (n,), (m,) int, the clip of each; equal numbers mean the same clip
    bandwidth : in the squared unit of the motions
    """
    codes = np.concatenate([x_clips, y_clips])
    counts = np.ones((1, int(codes.max()) + 1))
    parts = ((x, x, x_clips, x_clips), (y, y, y_clips, y_clips), (x, y, x_clips, y_clips))
    xx, yy, xy = (
        pair_means(mean_kernels(a, b, np.array([bandwidth]))[0], i, j, counts)[0]
        for a, b, i, j in parts
    )
    return float(xx + yy - 2 * xy)


def mmd_s(x: Array, y: Array, x_clips: Codes, y_clips: Codes, *, bandwidth: float) -> float:
    """Return the unbiased estimate of the squared MMD of whole sequences; see ``mmd_a``."""
    return mmd_a(as_sequence(x), as_sequence(y), x_clips, y_clips, bandwidth=bandwidth)


def mmd_a_published(x: Array, y: Array) -> float:
    """Return MMD-A as in MUGL: over all pairs, including each motion with itself.

    Parameters
    ----------
    x, y : (n, T, D), (m, T, D) metres
    """
    kernels = [mean_kernels(a, b, PUBLISHED_BANDWIDTHS) for a, b in ((x, x), (y, y), (x, y))]
    return published_statistic(kernels, np.ones(len(x)), np.ones(len(y)))


def mmd_s_published(x: Array, y: Array) -> float:
    """Return MMD-S as in MUGL; see ``mmd_a_published``."""
    return mmd_a_published(as_sequence(x), as_sequence(y))


def published_statistic(kernels: list[Array], x_counts: Array, y_counts: Array) -> float:
    """Return the mean of the running maxima, over growing bandwidths, of the biased estimates.

    Parameters
    ----------
    kernels : (K, n, n), (K, m, m), (K, n, m) of the pairs (x, x), (y, y), (x, y)
    x_counts, y_counts : (n,), (m,) the count of each motion
    """
    p, q = x_counts / x_counts.sum(), y_counts / y_counts.sum()
    xx, yy, xy = (k @ b @ a for k, a, b in zip(kernels, (p, q, p), (p, q, q), strict=True))
    return float(np.maximum.accumulate(xx + yy - 2 * xy).mean())
