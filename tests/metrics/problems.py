"""Random motions and features for the tests of metrics."""

import numpy as np

from pacmo_core.metrics.reactions import Reactions


def motions(n, rng, joints=3, shortest=5, longest=12):
    lengths = rng.integers(shortest, longest + 1, size=n)
    return [rng.normal(size=(length, joints, 3)).astype(np.float32) for length in lengths]


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def reactions(n_clips, prefix, rng, channels=2, r=6, further=0):
    """Two people a clip: 2·n_clips samples."""
    bodies = motions(2 * n_clips, rng)
    embedded = unit(rng.normal(size=(2 * n_clips, 4)))
    return Reactions(
        features=rng.normal(size=(2 * n_clips, channels, r)),
        motions=bodies,
        partners=[body + 1 for body in bodies],
        times=[np.arange(len(body)) / 30 for body in bodies],
        clips=[f"{prefix}{i // 2}" for i in range(2 * n_clips)],
        embedded=np.stack([embedded, unit(embedded + 0.1 * rng.normal(size=embedded.shape))]),
        units=[f"{prefix}{i // 4}" for i in range(2 * n_clips)],
        actions=[("wave", "bow")[i // 2 % 2] for i in range(2 * n_clips)],
        further=rng.normal(size=(further, 2 * n_clips, channels, r)),
        further_motions=[bodies] * further,
    )


def midpoint_grid(r):
    """Return the r cell midpoints of [0, 1] and their weights 1/r.

    Algorithm 1 of the paper instead gives r points that include both ends the weight 1/r, an error
    of order (r − 1)/r in the term of the mean.
    """
    return (np.arange(r) + 0.5) / r, np.full(r, 1 / r)


def f2id_of_gaussians(means, covariances, w):
    """Return the F²ID of two Gaussian processes given on the grid.

    Parameters
    ----------
    means : two arrays (C·r,), channel by channel
    covariances : two arrays (C·r, C·r)
    w : (r,) quadrature weights, sum 1
    """
    root = np.sqrt(np.tile(w, len(means[0]) // len(w)))
    first, second = (root[:, None] * k * root for k in covariances)
    values, vectors = np.linalg.eigh(first)
    # Round-off gives small negative eigenvalues.
    half = (vectors * np.sqrt(values.clip(0))) @ vectors.T
    cross = np.sqrt(np.linalg.eigvalsh(half @ second @ half).clip(0)).sum()
    shift = ((root * (means[0] - means[1])) ** 2).sum()
    return float(shift + np.trace(first) + np.trace(second) - 2 * cross)
