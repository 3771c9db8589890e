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
from scipy.interpolate import CubicSpline

Array = NDArray[np.float64]


def midpoint_grid(r: int) -> tuple[Array, Array]:
    """Lay out r cell midpoints of [0, 1] and their weights 1/r.

    Unlike algorithm 1 of the paper, which gives r points that include both ends the weight 1/r
    and so errs by a factor of order (r − 1)/r in the mean's term.
    """
    return (np.arange(r) + 0.5) / r, np.full(r, 1 / r)


def resample_to_grid(values: Array, source_grid: Array, grid: Array) -> Array:
    """Evaluate feature functions from their source_grid grid on another, by cubic splines.

    Parameters
    ----------
    values : (..., s), a function's values on its source_grid grid
    source_grid : (s,) strictly increasing
    grid : (r,) within ``source_grid``'s range

    Returns
    -------
    (..., r) float64

    Raises
    ------
    ValueError
        If the grid reaches beyond the range in which the function is known.
    """
    if grid.min() < source_grid[0] or grid.max() > source_grid[-1]:
        raise ValueError(
            f"grid must lie within [{source_grid[0]:g}, {source_grid[-1]:g}], "
            "where the features are known; "
            f"got [{grid.min():g}, {grid.max():g}]"
        )
    return np.asarray(CubicSpline(source_grid, values, axis=-1)(grid), dtype=np.float64)


def flatten(features: Array, weights: Array) -> Array:
    """Flatten (n, C, r) functions to (n, C·r) vectors of equal distances, L²(time) to ℓ²."""
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
    significant = lengths > lengths[0] * np.finfo(np.float64).eps * max(stacked.shape)
    rotated = stacked @ axes[significant].T
    return rotated[: len(x)], rotated[len(x) :]


def weighted_f2id(x: Array, y: Array, x_counts: Array, y_counts: Array) -> float:
    """Measure the F²ID of samples that each count as often as ``x_counts`` and ``y_counts`` say.

    Tr (K₁^½ K₂ K₁^½)^½ is the nuclear norm of A Bᵀ for any factors K₁ = AᵀA, K₂ = BᵀB: no root
    of a matrix is taken, and the smaller of the two spaces, samples or coordinates, is resampled.

    Parameters
    ----------
    x, y : (n, D), (m, D) coordinates
    x_counts, y_counts : (n,), (m,) not negative; a count of 2 is the sample, twice
    """
    x_mean, a = _centred_factor(x, x_counts)
    y_mean, b = _centred_factor(y, y_counts)
    cross = np.linalg.svd(_lower_triangle(a) @ _lower_triangle(b).T, compute_uv=False).sum()
    distance = ((x_mean - y_mean) ** 2).sum() + (a**2).sum() + (b**2).sum() - 2 * cross
    return max(float(distance), 0.0)  # round-off may leave a distance of zero below it


def f2id_of_gaussians(
    means: tuple[Array, Array], covariances: tuple[Array, Array], w: Array
) -> float:
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
    samples = counts > 0
    share = counts[samples] / counts.sum()
    mean = share @ x[samples]
    return mean, np.sqrt(share)[:, None] * (x[samples] - mean)


def _lower_triangle(factor: Array) -> Array:
    """Shorten a tall factor A to R of A = QR, with the same AᵀA."""
    tall = factor.shape[0] > factor.shape[1]
    return np.asarray(np.linalg.qr(factor, mode="r")) if tall else factor


Codes = NDArray[np.intp]


@dataclass(frozen=True)
class Gaussians:
    """B Gaussian reference, one a replicate.

    Parameters
    ----------
    means : (B, D)
    factors : (B, D, D), A with the covariance AᵀA
    """

    means: Array
    factors: Array


def fit_gaussians(x: Array, codes: Codes, counts: Array) -> Gaussians:
    """Fit a Gaussian to each replicate, by moments (PaCMO, A.1).

    The moments of a replicate are weighted moments of its clips, so the samples are read once for
    all replicates.

    Parameters
    ----------
    x : (n, D) coordinates
    codes : (n,) int, the column of ``counts`` of each sample's clip
    counts : (B, G) how often each replicate took each clip

    Returns
    -------
    Gaussians; replicates in which no clip of ``x`` stands are refused
    """
    used, source_grid = np.unique(codes, return_inverse=True)
    belongs = (source_grid == np.arange(len(used))[:, None]).astype(np.float64)
    weights = counts[:, used] @ belongs.sum(axis=1)
    if (weights <= 0).any():
        raise ValueError("wanted samples in every replicate; a replicate has none")
    centre = x.mean(axis=0)  # a common offset would swallow the covariance's digits
    y = x - centre
    products = (y[:, :, None] * y[:, None, :]).reshape(len(y), -1)
    means = counts[:, used] @ (belongs @ y) / weights[:, None]
    second = counts[:, used] @ (belongs @ products) / weights[:, None]
    covariances = second.reshape(len(counts), *2 * x.shape[1:])
    covariances -= means[:, :, None] * means[:, None, :]
    return Gaussians(centre + means, _covariance_factors(covariances))


def gaussian_distances(first: Gaussians, second: Gaussians) -> Array:
    """Measure F²ID replicate by replicate, (B,): see ``f2id`` for the formula."""
    products = first.factors @ second.factors.transpose(0, 2, 1)
    cross = np.linalg.svd(products, compute_uv=False).sum(axis=1)
    shift = ((first.means - second.means) ** 2).sum(axis=1)
    spread = (first.factors**2).sum(axis=(1, 2)) + (second.factors**2).sum(axis=(1, 2))
    # Round-off may leave a distance of zero below it.
    return np.asarray(np.maximum(shift + spread - 2 * cross, 0.0))


def _covariance_factors(covariances: Array) -> Array:
    values, vectors = np.linalg.eigh(covariances)
    # A covariance known to round-off has small negative eigenvalues.
    return np.asarray(np.sqrt(values.clip(0))[:, :, None] * vectors.transpose(0, 2, 1))


# Parts are made of quarters of the clips: all, three of four, and two; and 4 / (quarters) is 1/n.
_PART_SIZES = (
    ((0, 1, 2, 3),),
    ((1, 2, 3), (0, 2, 3), (0, 1, 3), (0, 1, 2)),
    ((0, 1), (2, 3)),
)
N_PARTS = sum(map(len, _PART_SIZES))


def split_into_parts(counts: Array, groups: Codes, generator: np.random.Generator) -> Array:
    """Deal the clips of each replicate into quarters, and join these to the parts of three sizes.

    Parameters
    ----------
    counts : (B, G) whole numbers, how often each replicate took each clip
    groups : (G,) int; each group (test clips, training clips) is permuted for itself

    Returns
    -------
    (B, P, G) how often each part holds each clip: everything first, then by falling size
    """
    quarters = np.zeros((len(counts), 4, counts.shape[1]))
    for replicate, into in zip(counts.astype(np.intp), quarters, strict=True):
        for group in np.unique(groups):
            members = np.flatnonzero(groups == group)
            samples = generator.permutation(np.repeat(members, replicate[members]))
            for quarter, clips in zip(into, np.array_split(samples, 4), strict=True):
                np.add.at(quarter, clips, 1)
    joined = [quarters[:, list(part)].sum(axis=1) for size in _PART_SIZES for part in size]
    return np.stack(joined, axis=1)


def extrapolate_to_infinity(values: Array) -> Array:
    """Draw the least-squares line in 1/n through the means of each size, and read it off at 0.

    Parameters
    ----------
    values : (..., P), the metric on each of ``deal_parts``' parts

    Returns
    -------
    (...)
    """
    parts = np.split(values, np.cumsum([len(size) for size in _PART_SIZES])[:-1], axis=-1)
    means = np.stack([part.mean(axis=-1) for part in parts], axis=-1)
    inverse = np.array([4 / len(size[0]) for size in _PART_SIZES])
    line = np.stack([inverse, np.ones(len(inverse))], axis=1)
    return np.asarray(means @ np.linalg.pinv(line)[1])
