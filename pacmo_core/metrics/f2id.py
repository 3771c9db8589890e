"""F²ID: the squared Wasserstein-2 distance between Gaussian processes fitted to features.

A feature is a function of normalised time with values in C channels, given on a grid of r points
of [0, 1] that is common to all features, with quadrature weights that sum to 1. The distance is

    ∫ |m₁ − m₂|² + Tr K₁ + Tr K₂ − 2 Tr (K₁^½ K₂ K₁^½)^½

of the covariance operators on (time, channel): PaCMO (2022), equation 3 and algorithm 1, with the
root on the last trace alone and no root over the whole, as in Mallasto and Feragen (2017),
*Learning from uncertain curves*, which the paper follows. It is the Fréchet distance of the fitted
Gaussian processes. The same is computed for every bootstrap replicate at once from weighted
moments, and extrapolated to infinitely many samples.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def flatten(features: Array, weights: Array) -> Array:
    """Flatten (n, C, r) functions to (n, C·r) vectors whose ℓ² distances are those in L²(time)."""
    if features.ndim != 3 or weights.shape != features.shape[-1:]:
        raise ValueError(
            f"features must be (n, C, r) and weights (r,); got {features.shape}, {weights.shape}"
        )
    if (weights < 0).any() or abs(weights.sum() - 1) > 1e-9:
        raise ValueError(f"weights must be positive and sum to 1; they sum to {weights.sum()}")
    scaled = features.astype(np.float64) * np.sqrt(weights)
    return scaled.reshape(len(features), -1)


def f2id(real: Array, generated: Array, weights: Array) -> float:
    """Return the F²ID of two sets of feature functions.

    Parameters
    ----------
    real : (n, C, r)
    generated : (m, C, r)
    weights : (r,) quadrature weights, sum 1

    Returns
    -------
    float, squared unit of the features
    """
    x, y = common_coordinates(flatten(real, weights), flatten(generated, weights))
    return weighted_f2id(x, y, np.ones(len(x)), np.ones(len(y)))


def common_coordinates(x: Array, y: Array) -> tuple[Array, Array]:
    """Return (n, D) and (m, D) vectors in coordinates of the smallest space that contains both.

    Distances do not change. Directions below the round-off of the largest are omitted.
    """
    stacked = np.concatenate([x, y])
    stacked = stacked - stacked.mean(axis=0)
    _, lengths, axes = np.linalg.svd(stacked, full_matrices=False)
    significant = lengths > lengths[0] * np.finfo(np.float64).eps * max(stacked.shape)
    rotated = stacked @ axes[significant].T
    return rotated[: len(x)], rotated[len(x) :]


def weighted_f2id(x: Array, y: Array, x_counts: Array, y_counts: Array) -> float:
    """Return the F²ID of weighted samples.

    Tr (K₁^½ K₂ K₁^½)^½ is the nuclear norm of A Bᵀ for any factors K₁ = AᵀA, K₂ = BᵀB: no
    matrix root is computed, and the products have the smaller of the two dimensions.

    Parameters
    ----------
    x, y : (n, D), (m, D) coordinates
    x_counts, y_counts : (n,), (m,) not negative; how often each sample counts
    """
    x_mean, a = _centred_factor(x, x_counts)
    y_mean, b = _centred_factor(y, y_counts)
    cross = np.linalg.svd(_lower_triangle(a) @ _lower_triangle(b).T, compute_uv=False).sum()
    distance = ((x_mean - y_mean) ** 2).sum() + (a**2).sum() + (b**2).sum() - 2 * cross
    return max(float(distance), 0.0)  # round-off can make zero negative


def _centred_factor(x: Array, counts: Array) -> tuple[Array, Array]:
    """Return the mean (D,) and a factor A (k, D) of the covariance AᵀA, by moments (A.1)."""
    used = counts > 0
    weights = counts[used] / counts.sum()
    mean = weights @ x[used]
    return mean, np.sqrt(weights)[:, None] * (x[used] - mean)


def _lower_triangle(factor: Array) -> Array:
    """Return R of A = QR for a tall factor A; AᵀA is the same."""
    tall = factor.shape[0] > factor.shape[1]
    return np.asarray(np.linalg.qr(factor, mode="r")) if tall else factor


Codes = NDArray[np.intp]


@dataclass(frozen=True)
class Gaussians:
    """Gaussian distributions of B replicates.

    Parameters
    ----------
    means : (B, D)
    factors : (B, D, D), A with the covariance AᵀA
    """

    means: Array
    factors: Array


def fit_gaussians(x: Array, codes: Codes, counts: Array) -> Gaussians:
    """Fit a Gaussian to each replicate, by moments (PaCMO, A.1).

    The moments of a replicate are weighted moments of its clips, so that all are computed at once.

    Parameters
    ----------
    x : (n, D) coordinates
    codes : (n,) int, the column of ``counts`` of each sample's clip
    counts : (B, G) the count of each clip in each replicate

    Returns
    -------
    Gaussians of all replicates

    Raises
    ------
    ValueError
        If a replicate has no clip of ``x``.
    """
    used, inverse = np.unique(codes, return_inverse=True)
    belongs = (inverse == np.arange(len(used))[:, None]).astype(np.float64)
    weights = counts[:, used] @ belongs.sum(axis=1)
    if (weights <= 0).any():
        raise ValueError("wanted samples in every replicate; a replicate has none")
    centre = x.mean(axis=0)  # without a common offset, which costs digits of the covariance
    y = x - centre
    products = (y[:, :, None] * y[:, None, :]).reshape(len(y), -1)
    means = counts[:, used] @ (belongs @ y) / weights[:, None]
    second = counts[:, used] @ (belongs @ products) / weights[:, None]
    covariances = second.reshape(len(counts), *2 * x.shape[1:])
    covariances -= means[:, :, None] * means[:, None, :]
    return Gaussians(centre + means, _covariance_factors(covariances))


def gaussian_distances(first: Gaussians, second: Gaussians) -> Array:
    """Return the F²ID of each replicate, (B,); the formula is that of ``f2id``."""
    products = first.factors @ second.factors.transpose(0, 2, 1)
    cross = np.linalg.svd(products, compute_uv=False).sum(axis=1)
    shift = ((first.means - second.means) ** 2).sum(axis=1)
    spread = (first.factors**2).sum(axis=(1, 2)) + (second.factors**2).sum(axis=(1, 2))
    # Round-off can make zero negative.
    return np.asarray(np.maximum(shift + spread - 2 * cross, 0.0))


def _covariance_factors(covariances: Array) -> Array:
    values, vectors = np.linalg.eigh(covariances)
    # Round-off gives small negative eigenvalues.
    return np.asarray(np.sqrt(values.clip(0))[:, :, None] * vectors.transpose(0, 2, 1))


# Parts consist of 4, 3 or 2 quarters of the clips; 4 / quarters is proportional to 1/n.
_PART_SIZES = (
    ((0, 1, 2, 3),),
    ((1, 2, 3), (0, 2, 3), (0, 1, 3), (0, 1, 2)),
    ((0, 1), (2, 3)),
)


def split_into_parts(counts: Array, groups: Codes, generator: np.random.Generator) -> Array:
    """Split the clips of each replicate into quarters; return the parts of three sizes.

    Parameters
    ----------
    counts : (B, G) integers, the count of each clip in each replicate
    groups : (G,) int; groups (test clips, training clips) are split separately

    Returns
    -------
    (B, P, G) the count of each clip in each part: all quarters first, then by decreasing size
    """
    quarters = np.zeros((len(counts), 4, counts.shape[1]))
    for replicate, parts in zip(counts.astype(np.intp), quarters, strict=True):
        for group in np.unique(groups):
            members = np.flatnonzero(groups == group)
            samples = generator.permutation(np.repeat(members, replicate[members]))
            for quarter, clips in zip(parts, np.array_split(samples, 4), strict=True):
                np.add.at(quarter, clips, 1)
    joined = [quarters[:, list(part)].sum(axis=1) for size in _PART_SIZES for part in size]
    return np.stack(joined, axis=1)


def extrapolate_to_infinity(values: Array) -> Array:
    """Fit a least-squares line in 1/n to the means of each size; return its value at 0.

    Parameters
    ----------
    values : (..., P), the metric on each part of ``split_into_parts``

    Returns
    -------
    (...)
    """
    parts = np.split(values, np.cumsum([len(size) for size in _PART_SIZES])[:-1], axis=-1)
    means = np.stack([part.mean(axis=-1) for part in parts], axis=-1)
    inverse = np.array([4 / len(size[0]) for size in _PART_SIZES])
    line = np.stack([inverse, np.ones(len(inverse))], axis=1)
    return np.asarray(means @ np.linalg.pinv(line)[1])
