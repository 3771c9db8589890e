"""Metrics of one row of a table that compare reactions with real ones: laws and displacement."""

import numpy as np

from pacmo_core.metrics.displacement import position_errors, variance_errors
from pacmo_core.metrics.diversity import disjoint_pair_mean, feature_distances
from pacmo_core.metrics.f2id import common_coordinates, flatten, weighted_f2id
from pacmo_core.metrics.intervals import Array, Estimate
from pacmo_core.metrics.laws import Laws
from pacmo_core.metrics.mmd import as_sequence, mean_kernels, published_statistic
from pacmo_core.metrics.pairs import Codes, pair_means
from pacmo_core.metrics.reactions import Reactions
from pacmo_core.metrics.yardstick import Yardstick

Estimates = dict[str, Estimate]


def measure_f2id(row: Reactions, laws: Laws, yardstick: Yardstick) -> Estimates:
    """Measure F²ID of joint features: plain, beyond a second draw's, and of infinite samples."""
    x = flatten(row.features, yardstick.weights)
    codes = yardstick.codes(row)
    draws = {
        "f2id": laws.between(x, codes),
        "f2id_excess": laws.second(x, codes) - laws.floor,
        "f2id_infinity": laws.infinity(x, codes),
    }
    return {name: as_estimate(values) for name, values in draws.items()}


def published_f2id(row: Reactions, yardstick: Yardstick) -> Estimates:
    """Measure F²ID by the paper's protocol."""
    vectors = (flatten(part.features, yardstick.weights) for part in (yardstick.real, row))
    x, y = common_coordinates(*vectors)
    values = [
        weighted_f2id(x, y, times_drawn(a, len(x)), times_drawn(b, len(y)))
        for a, b in yardstick.drawn(row)
    ]
    return {"f2id_published": as_repeats(values)}


def measure_mmd(row: Reactions, codes: Codes, yardstick: Yardstick) -> Estimates:
    """Measure MMD-A and MMD-S, unbiased, and by the paper's protocol."""
    i = yardstick.partners
    stacked = yardstick.stacked(row)
    shaped = {"mmd_a": stacked, "mmd_s": as_sequence(stacked)}
    found: Estimates = {}
    for name, real in yardstick.real_kernels.items():
        yy = mean_kernels(shaped[name], shaped[name], real.bandwidths)
        xy = mean_kernels(real.motions, shaped[name], real.bandwidths)
        means = [
            pair_means(kernel[0], *clips, yardstick.counts)
            for kernel, clips in ((real.kernels, (i, i)), (yy, (codes, codes)), (xy, (i, codes)))
        ]
        found[name] = as_estimate(means[0] + means[1] - 2 * means[2])
        kernels = [real.kernels[1:], yy[1:], xy[1:]]
        paper = [
            published_statistic(kernels, times_drawn(a, len(i)), times_drawn(b, len(codes)))
            for a, b in yardstick.drawn(row)
        ]
        found[f"{name}_published"] = as_repeats(paper)
    return found


def measure_diversity(row: Reactions, codes: Codes, yardstick: Yardstick) -> Estimates:
    """Measure diversity, squared and plain, and by the paper's protocol."""
    squared = feature_distances(row.features, yardstick.weights, squared=True)
    draws = {"diversity": squared, "diversity_l2": np.sqrt(squared)}
    found = {
        name: as_estimate(pair_means(distances, codes, codes, yardstick.counts))
        for name, distances in draws.items()
    }
    paper = [disjoint_pair_mean(squared, drawn) for _, drawn in yardstick.drawn(row)]
    return found | {"diversity_published": as_repeats(paper)}


def measure_displacement(row: Reactions, yardstick: Yardstick) -> Estimates:
    """Compare each reaction with the real one to the same partner: APE and AVE."""
    errors = {
        "ape": position_errors(row.motions, yardstick.real.motions),
        "ave": variance_errors(row.motions, yardstick.real.motions),
    }
    # Clips are weighted by the partner's, also where the reaction comes from another clip.
    shares = yardstick.counts[:, yardstick.partners]
    shares = shares / shares.sum(axis=1, keepdims=True)
    root = {name: value[:, yardstick.settings.body.root] for name, value in errors.items()}
    joints = {f"{name}_joints": value.mean(axis=1) for name, value in errors.items()}
    return {name: as_estimate(shares @ value) for name, value in (root | joints).items()}


def as_estimate(draws: Array) -> Estimate:
    """Split draws of which the first has every clip once."""
    return Estimate(float(draws[0]), draws[1:])


def as_repeats(values: list[float]) -> Estimate:
    """Hold repeats of the paper's protocol beside their mean."""
    return Estimate(float(np.mean(values)), np.array(values))


def times_drawn(drawn: Codes, n: int) -> Array:
    """Count how often each of n samples was drawn."""
    return np.bincount(drawn, minlength=n).astype(np.float64)
