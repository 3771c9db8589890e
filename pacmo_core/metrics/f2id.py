"""F²ID: the squared Wasserstein-2 distance between Gaussian processes fitted to features.

A feature is a function of normalised time with values in C channels, given on a grid of r points
of [0, 1] that is common to all features, with quadrature weights that sum to 1. The distance is

    ∫ |m₁ − m₂|² + Tr K₁ + Tr K₂ − 2 Tr (K₁^½ K₂ K₁^½)^½

of the covariance operators on (time, channel): PaCMO (2022), equation 3 and algorithm 1, with the
root on the last trace alone and no root over the whole, as in Mallasto and Feragen (2017),
*Learning from uncertain curves*, which the paper follows.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

Array = NDArray[np.float64]


def midpoint_grid(r: int) -> tuple[Array, Array]:
    """Lay out r cell midpoints of [0, 1] and their weights 1/r.

    Unlike algorithm 1 of the paper, which gives r points that include both ends the weight 1/r
    and so errs by a factor of order (r − 1)/r in the mean's term.
    """
    return (np.arange(r) + 0.5) / r, np.full(r, 1 / r)


def on_grid(values: Array, own: Array, grid: Array) -> Array:
    """Evaluate feature functions from their own grid on another, by cubic splines.

    Parameters
    ----------
    values : (..., s), a function's values on its own grid
    own : (s,) strictly increasing
    grid : (r,) within ``own``'s range

    Returns
    -------
    (..., r) float64

    Raises
    ------
    ValueError
        If the grid reaches beyond the range in which the function is known.
    """
    if grid.min() < own[0] or grid.max() > own[-1]:
        raise ValueError(
            f"grid must lie within [{own[0]:g}, {own[-1]:g}], where the features are known; "
            f"got [{grid.min():g}, {grid.max():g}]"
        )
    return np.asarray(CubicSpline(own, values, axis=-1)(grid), dtype=np.float64)


def flatten(features: Array, weights: Array) -> Array:
    """Turn (n, C, r) functions into (n, C·r) vectors with the same distances, L²(time) to ℓ²."""
    if features.ndim != 3 or weights.shape != features.shape[-1:]:
        raise ValueError(
            f"features must be (n, C, r) and weights (r,); got {features.shape}, {weights.shape}"
        )
    if (weights < 0).any() or abs(weights.sum() - 1) > 1e-9:
        raise ValueError(f"weights must be positive and sum to 1; they sum to {weights.sum()}")
    scaled = features.astype(np.float64) * np.sqrt(weights)
    return scaled.reshape(len(features), -1)


def f2id(real: Array, generated: Array, weights: Array) -> float:
    """Measure the F²ID of two sets of feature functions.

    Parameters
    ----------
    real : (n, C, r)
    generated : (m, C, r)
    weights : (r,) quadrature weights, sum 1

    Returns
    -------
    float, in the squared unit of the features
    """
    x, y = common_coordinates(flatten(real, weights), flatten(generated, weights))
    return weighted_f2id(x, y, np.ones(len(x)), np.ones(len(y)))


def common_coordinates(x: Array, y: Array) -> tuple[Array, Array]:
    """Rotate (n, D) and (m, D) vectors into the smallest space that holds both, about its mean.

    The distance does not change; a bottleneck of 40 numbers on 64 points costs 40 dimensions
    again. Directions below the round-off of the largest are left out.
    """
    stacked = np.concatenate([x, y])
    stacked = stacked - stacked.mean(axis=0)
    _, lengths, axes = np.linalg.svd(stacked, full_matrices=False)
    kept = lengths > lengths[0] * np.finfo(np.float64).eps * max(stacked.shape)
    rotated = stacked @ axes[kept].T
    return rotated[: len(x)], rotated[len(x) :]


def weighted_f2id(x: Array, y: Array, x_counts: Array, y_counts: Array) -> float:
    """Measure the F²ID of samples that each count as often as ``x_counts`` and ``y_counts`` say.

    Tr (K₁^½ K₂ K₁^½)^½ is the nuclear norm of A Bᵀ for any factors K₁ = AᵀA, K₂ = BᵀB: no root
    of a matrix is taken, and the smaller of the two spaces, samples or coordinates, is chosen.

    Parameters
    ----------
    x, y : (n, D), (m, D) coordinates
    x_counts, y_counts : (n,), (m,) not negative; a count of 2 is the sample, twice
    """
    x_mean, a = _centred_factor(x, x_counts)
    y_mean, b = _centred_factor(y, y_counts)
    cross = np.linalg.svd(_triangle(a) @ _triangle(b).T, compute_uv=False).sum()
    distance = ((x_mean - y_mean) ** 2).sum() + (a**2).sum() + (b**2).sum() - 2 * cross
    return max(float(distance), 0.0)  # round-off may leave a distance of zero below it


def f2id_of_laws(means: tuple[Array, Array], covariances: tuple[Array, Array], w: Array) -> float:
    """Measure the F²ID of two Gaussian processes given by their functions on the grid.

    Parameters
    ----------
    means : two arrays (C·r,), channel by channel
    covariances : two arrays (C·r, C·r)
    w : (r,) quadrature weights, sum 1
    """
    root = np.sqrt(np.tile(w, len(means[0]) // len(w)))
    first, second = (root[:, None] * k * root for k in covariances)
    values, vectors = np.linalg.eigh(first)
    # A covariance known to round-off has small negative eigenvalues.
    half = (vectors * np.sqrt(values.clip(0))) @ vectors.T
    cross = np.sqrt(np.linalg.eigvalsh(half @ second @ half).clip(0)).sum()
    shift = ((root * (means[0] - means[1])) ** 2).sum()
    return float(shift + np.trace(first) + np.trace(second) - 2 * cross)


def _centred_factor(x: Array, counts: Array) -> tuple[Array, Array]:
    """Return the mean (D,) and a factor A (k, D) of the covariance AᵀA, by moments (A.1)."""
    drawn = counts > 0
    share = counts[drawn] / counts.sum()
    mean = share @ x[drawn]
    return mean, np.sqrt(share)[:, None] * (x[drawn] - mean)


def _triangle(factor: Array) -> Array:
    """Shorten a tall factor A to R of A = QR, with the same AᵀA."""
    tall = factor.shape[0] > factor.shape[1]
    return np.asarray(np.linalg.qr(factor, mode="r")) if tall else factor
