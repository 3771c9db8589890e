"""Trusted: F²ID of one draw at a time, and Gaussian processes whose distance is known."""

import numpy as np
import pytest

from pacmo_core.metrics.f2id import (
    extrapolate_to_infinity,
    fit_gaussians,
    gaussian_distances,
    split_into_parts,
    weighted_f2id,
)
from tests.metrics.problems import f2id_of_gaussians, midpoint_grid


def test_all_draws_at_once_are_the_draws_one_by_one():
    rng = np.random.default_rng(0)
    x, y = 3 + rng.normal(size=(20, 4)), 2 * rng.normal(size=(14, 4))
    i, j = rng.integers(6, size=20), 3 + rng.integers(6, size=14)
    counts = 1.0 + rng.integers(3, size=(5, 9))
    found = gaussian_distances(fit_gaussians(x, i, counts), fit_gaussians(y, j, counts))
    expected = [weighted_f2id(x, y, draw[i], draw[j]) for draw in counts]
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_a_set_is_at_no_distance_from_itself_also_with_fewer_samples_than_coordinates():
    x, codes = np.random.default_rng(1).normal(size=(5, 9)), np.arange(5)
    gaussian = fit_gaussians(x, codes, np.ones((2, 5)))
    np.testing.assert_allclose(gaussian_distances(gaussian, gaussian), 0, atol=1e-12)
    moved = fit_gaussians(x + 1, codes, np.ones((2, 5)))
    np.testing.assert_allclose(gaussian_distances(gaussian, moved), 9, rtol=1e-9)


def test_a_draw_without_samples_is_refused():
    with pytest.raises(ValueError, match="every replicate"):
        fit_gaussians(np.zeros((2, 1)), np.array([0, 0]), np.array([[1.0, 0], [0, 2]]))


def test_parts_are_everything_three_quarters_and_halves_of_each_group():
    groups = np.repeat([0, 1], [8, 12])
    counts = np.array([[1] * 20, [2, 0] * 4 + [0, 0, 3] * 4]).astype(float)
    parts = split_into_parts(counts, groups, np.random.default_rng(0))
    assert parts.shape == (2, 1 + 4 + 2, 20)
    np.testing.assert_array_equal(parts[:, 0], counts)
    np.testing.assert_array_equal(parts[:, 1:5].sum(axis=1), 3 * counts)
    np.testing.assert_array_equal(parts[:, 5] + parts[:, 6], counts)
    np.testing.assert_array_equal(parts[:, 1, :8].sum(axis=1), 6)
    np.testing.assert_array_equal(parts[:, 5, 8:].sum(axis=1), 6)


def test_a_line_in_one_over_n_is_read_off_at_infinity():
    inverse = np.repeat([1, 4 / 3, 2], [1, 4, 2])
    noise = np.array([0, 1, -1, 2, -2, 3, -3])  # parts of one size count by their mean
    assert extrapolate_to_infinity(0.7 + 0.2 * inverse + noise) == pytest.approx(0.7)


def samples(kernel, mean, n, rng):
    root = np.linalg.cholesky(kernel + 1e-9 * np.eye(len(kernel)))
    return mean + rng.normal(size=(n, len(kernel))) @ root.T


@pytest.mark.parametrize("doubled", [False, True])
def test_extrapolation_finds_the_distance_of_two_gaussian_processes_that_few_samples_hide(doubled):
    x, w = midpoint_grid(16)
    kernel = np.exp(-((x[:, None] - x) ** 2) / (2 * 0.05**2))
    means = (0 * x, 0.3 * np.sin(2 * np.pi * x))
    kernels = (kernel, 4 * kernel if doubled else kernel)
    # ∫ (0.3 sin)² = 0.045; a doubled process lies its own variance, 1, from itself.
    assert f2id_of_gaussians(means, kernels, w) == pytest.approx(0.045 + doubled, abs=1e-6)
    rng = np.random.default_rng(doubled)
    plain, infinite = [], []
    for _ in range(30):
        a, b = (samples(k, m, 80, rng) / 4 for k, m in zip(kernels, means, strict=True))
        codes = np.arange(80) // 2
        parts = split_into_parts(np.ones((1, 40)), np.zeros(40, dtype=int), rng)[0]
        values = gaussian_distances(fit_gaussians(a, codes, parts), fit_gaussians(b, codes, parts))
        plain.append(values[0])
        infinite.append(extrapolate_to_infinity(values))
    assert np.mean(plain) > 0.045 + doubled + 0.08
    assert np.mean(infinite) == pytest.approx(0.045 + doubled, abs=0.03)
