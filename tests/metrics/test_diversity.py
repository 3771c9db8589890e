"""Trusted: the spread of a Gaussian process, 2 Tr K, and pairs counted by hand."""

import numpy as np
import pytest

from pacmo_core.metrics.diversity import disjoint_pair_mean, diversity, feature_distances
from tests.metrics.problems import midpoint_grid


def test_squared_diversity_averages_to_twice_the_trace_of_the_covariance():
    rng = np.random.default_rng(0)
    _, w = midpoint_grid(8)
    scale = np.linspace(0.5, 2, 8)
    features = scale * rng.normal(size=(4000, 3, 8))
    found = diversity(features, w, squared=True, generator=rng)
    assert found == pytest.approx(2 * 3 * np.mean(scale**2), rel=0.03)


def test_distances_are_the_norm_over_time_and_its_square():
    features = np.array([[[0.0, 0.0]], [[3.0, 4.0]]])
    w = np.array([0.25, 0.75])
    assert feature_distances(features, w, squared=True)[0, 1] == pytest.approx(9 / 4 + 12)
    assert feature_distances(features, w, squared=False)[0, 1] == pytest.approx(np.sqrt(14.25))


def test_each_sample_is_in_one_pair():
    distances = np.zeros((4, 4))
    distances[0, 2], distances[1, 3] = 2.0, 4.0
    assert disjoint_pair_mean(distances, np.array([0, 1, 2, 3])) == pytest.approx(3.0)
    with pytest.raises(ValueError, match="at least 2"):
        disjoint_pair_mean(distances, np.array([1]))


def test_one_random_seed_gives_one_diversity():
    features = np.random.default_rng(1).normal(size=(20, 1, 4))
    _, w = midpoint_grid(4)
    first, again, other = (
        diversity(features, w, squared=False, generator=np.random.default_rng(s)) for s in (5, 5, 6)
    )
    assert first == again != other
