"""Each metric of one row: on all samples, on every draw of clips, and by the paper's protocol."""

import numpy as np

from pacmo_core.metrics.displacement import position_errors, variance_errors
from pacmo_core.metrics.diversity import disjoint_pair_mean, feature_distances
from pacmo_core.metrics.f2id import common_coordinates, flatten, weighted_f2id
from pacmo_core.metrics.intervals import Array, Estimate, Interval, repeated
from pacmo_core.metrics.mmd import as_sequence, mean_kernels, published_statistic
from pacmo_core.metrics.pairs import pair_means
from pacmo_core.metrics.reactions import Reactions
from pacmo_core.metrics.yardstick import Yardstick

Metrics = tuple[dict[str, Estimate], dict[str, Interval]]


def measure_laws(row: Reactions, yardstick: Yardstick) -> Metrics:
    """Compare a row with the real reactions as two samples of laws: F²ID, MMD, diversity."""
    parts = [_f2id(row, yardstick), _mmd(row, yardstick), _diversity(row, yardstick)]
    estimates = {name: e for part, _ in parts for name, e in part.items()}
    return estimates, {name: i for _, part in parts for name, i in part.items()}


def measure_displacement(row: Reactions, yardstick: Yardstick) -> dict[str, Estimate]:
    """Compare each reaction with the real one to the same partner: APE and AVE."""
    errors = {
        "ape": position_errors(row.motions, yardstick.real.motions),
        "ave": variance_errors(row.motions, yardstick.real.motions),
    }
    # Clips are weighted by the partner's, also where the reaction comes from another clip.
    counts = yardstick.counts[:, yardstick.codes(yardstick.real)]
    shares = counts / counts.sum(axis=1, keepdims=True)
    root = {name: value[:, yardstick.settings.root] for name, value in errors.items()}
    joints = {f"{name}_joints": value.mean(axis=1) for name, value in errors.items()}
    return {name: _estimate(shares @ value) for name, value in (root | joints).items()}


def _f2id(row: Reactions, yardstick: Yardstick) -> Metrics:
    real = yardstick.real
    vectors = (flatten(part.features, yardstick.weights) for part in (real, row))
    x, y = common_coordinates(*vectors)
    i, j = yardstick.codes(real), yardstick.codes(row)
    draws = np.array([weighted_f2id(x, y, c[i], c[j]) for c in yardstick.counts])
    paper = [
        weighted_f2id(x, y, _times(a, len(x)), _times(b, len(y)))
        for a, b in zip(yardstick.real_drawn, yardstick.row_drawn, strict=True)
    ]
    return {"f2id": _estimate(draws)}, {"f2id_published": repeated(np.array(paper))}


def _mmd(row: Reactions, yardstick: Yardstick) -> Metrics:
    i, j = yardstick.codes(yardstick.real), yardstick.codes(row)
    stacked = yardstick.stacked(row)
    shaped = {"mmd_a": stacked, "mmd_s": as_sequence(stacked)}
    estimates, published = {}, {}
    for name, real in yardstick.real_kernels.items():
        yy = mean_kernels(shaped[name], shaped[name], real.bandwidths)
        xy = mean_kernels(real.motions, shaped[name], real.bandwidths)
        means = [
            pair_means(kernel[0], *clips, yardstick.counts)
            for kernel, clips in ((real.kernels, (i, i)), (yy, (j, j)), (xy, (i, j)))
        ]
        estimates[name] = _estimate(means[0] + means[1] - 2 * means[2])
        kernels = [real.kernels[1:], yy[1:], xy[1:]]
        paper = [
            published_statistic(kernels, _times(a, len(i)), _times(b, len(j)))
            for a, b in zip(yardstick.real_drawn, yardstick.row_drawn, strict=True)
        ]
        published[f"{name}_published"] = repeated(np.array(paper))
    return estimates, published


def _diversity(row: Reactions, yardstick: Yardstick) -> Metrics:
    codes = yardstick.codes(row)
    squared = feature_distances(row.features, yardstick.weights, squared=True)
    draws = {"diversity": squared, "diversity_l2": np.sqrt(squared)}
    estimates = {
        name: _estimate(pair_means(distances, codes, codes, yardstick.counts))
        for name, distances in draws.items()
    }
    paper = np.array([disjoint_pair_mean(squared, drawn) for drawn in yardstick.row_drawn])
    return estimates, {"diversity_published": repeated(paper)}


def _estimate(draws: Array) -> Estimate:
    """Split draws of which the first has every clip once."""
    return Estimate(float(draws[0]), draws[1:])


def _times(drawn: np.ndarray[tuple[int], np.dtype[np.intp]], n: int) -> Array:
    """Count how often each of n samples was drawn."""
    return np.bincount(drawn, minlength=n).astype(np.float64)
