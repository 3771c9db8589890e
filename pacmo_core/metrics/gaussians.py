"""Gaussian laws fitted to every bootstrap draw of a set of samples at once, and their distances."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Codes = NDArray[np.intp]


@dataclass(frozen=True)
class Gaussians:
    """B Gaussian laws, one a draw.

    Parameters
    ----------
    means : (B, D)
    factors : (B, D, D), A with the covariance AᵀA
    """

    means: Array
    factors: Array


def fit_gaussians(x: Array, codes: Codes, counts: Array) -> Gaussians:
    """Fit a Gaussian to each draw, by moments (PaCMO, A.1).

    The moments of a draw are those of its clips, weighted: so the samples are gone through once,
    however many draws there are.

    Parameters
    ----------
    x : (n, D) coordinates
    codes : (n,) int, the column of ``counts`` of each sample's clip
    counts : (B, G) how often each draw took each clip

    Returns
    -------
    Gaussians; draws in which no clip of ``x`` stands are refused
    """
    used, own = np.unique(codes, return_inverse=True)
    belongs = (own == np.arange(len(used))[:, None]).astype(np.float64)
    weights = counts[:, used] @ belongs.sum(axis=1)
    if (weights <= 0).any():
        raise ValueError("wanted samples in every draw; a draw has none")
    centre = x.mean(axis=0)  # a common offset would swallow the covariance's digits
    y = x - centre
    products = (y[:, :, None] * y[:, None, :]).reshape(len(y), -1)
    means = counts[:, used] @ (belongs @ y) / weights[:, None]
    second = counts[:, used] @ (belongs @ products) / weights[:, None]
    covariances = second.reshape(len(counts), *2 * x.shape[1:])
    covariances -= means[:, :, None] * means[:, None, :]
    return Gaussians(centre + means, _factors(covariances))


def distances(first: Gaussians, second: Gaussians) -> Array:
    """Measure F²ID draw by draw, (B,): see ``f2id`` for the formula."""
    products = first.factors @ second.factors.transpose(0, 2, 1)
    cross = np.linalg.svd(products, compute_uv=False).sum(axis=1)
    shift = ((first.means - second.means) ** 2).sum(axis=1)
    spread = (first.factors**2).sum(axis=(1, 2)) + (second.factors**2).sum(axis=(1, 2))
    # Round-off may leave a distance of zero below it.
    return np.asarray(np.maximum(shift + spread - 2 * cross, 0.0))


def _factors(covariances: Array) -> Array:
    values, vectors = np.linalg.eigh(covariances)
    # A covariance known to round-off has small negative eigenvalues.
    return np.asarray(np.sqrt(values.clip(0))[:, :, None] * vectors.transpose(0, 2, 1))
