"""Trusted: Wasserstein distances of Gaussian processes worked out by hand, and SciPy's sqrtm."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import sqrtm

from pacmo_core.metrics.f2id import (
    common_coordinates,
    f2id,
    flatten,
    weighted_f2id,
)
from tests.metrics.problems import f2id_of_gaussians, midpoint_grid


def trapezoid_grid(r):
    weights = np.full(r, 1 / (r - 1))
    weights[[0, -1]] /= 2
    return np.linspace(0, 1, r), weights


def smooth(grid, length):
    return np.exp(-((grid[:, None] - grid) ** 2) / (2 * length**2))


def brownian(grid):
    return np.minimum(grid[:, None], grid)


def bridge(grid):
    return brownian(grid) - grid[:, None] * grid


def diagonal(grid, power):
    j = np.arange(1, 7)
    basis = np.sqrt(2) * np.cos(np.pi * j * grid[:, None])
    return (basis * j**-power) @ basis.T


GRIDS = pytest.mark.parametrize("make_grid", [midpoint_grid, trapezoid_grid])


@GRIDS
@pytest.mark.parametrize("r", [16, 64])
def test_a_shift_and_a_doubling_of_one_process_cost_their_squares(make_grid, r):
    x, w = make_grid(r)
    k = smooth(x, 0.2)
    shift = np.sin(2 * np.pi * x)
    assert f2id_of_gaussians((0 * x, shift), (k, 4 * k), w) == pytest.approx(1.5, abs=2e-6)


@GRIDS
def test_processes_with_one_eigenbasis_differ_by_the_roots_of_their_eigenvalues(make_grid):
    x, w = make_grid(16)
    j = np.arange(1, 7.0)
    expected = 0.09 + ((1 / j - j**-1.5) ** 2).sum()
    assert expected == pytest.approx(0.16886956, abs=1e-8)
    gaussians = diagonal(x, 2.0), diagonal(x, 3.0)
    found = f2id_of_gaussians((0 * x, 0 * x + 0.3), gaussians, w)
    assert found == pytest.approx(expected, abs=2e-6)


@GRIDS
@pytest.mark.parametrize("r", [32, 256])
def test_brownian_motion_lies_half_from_its_double(make_grid, r):
    x, w = make_grid(r)
    found = f2id_of_gaussians((0 * x, 0 * x), (brownian(x), 4 * brownian(x)), w)
    assert found == pytest.approx(0.5, abs=1e-6)


def test_brownian_motion_and_its_bridge_approach_the_reference_with_resolution():
    coarse, fine = (
        f2id_of_gaussians((0 * x, 0 * x), (brownian(x), bridge(x)), w)
        for x, w in (midpoint_grid(64), trapezoid_grid(512))
    )
    assert coarse == pytest.approx(0.15407, abs=1e-5)
    assert fine == pytest.approx(0.15426, abs=2e-5)


def test_processes_of_two_lengths_stand_at_the_reference():
    x, w = trapezoid_grid(256)
    found = f2id_of_gaussians((0 * x, 0 * x), (smooth(x, 0.2), smooth(x, 0.1)), w)
    assert found == pytest.approx(0.17219, abs=1e-4)


@pytest.mark.parametrize(("n", "m"), [(200, 150), (9, 14), (60, 7)])
def test_the_low_rank_form_is_that_of_the_sample_covariances(n, m):
    rng = np.random.default_rng(n)
    _, w = trapezoid_grid(7)
    x, y = rng.normal(size=(n, 3, 7)), 0.4 + 2 * rng.normal(size=(m, 3, 7)).cumsum(axis=2)
    flat = [f.reshape(len(f), -1) for f in (x, y)]
    means = tuple(f.mean(axis=0) for f in flat)
    covariances = tuple(np.cov(f.T, ddof=0) for f in flat)
    assert f2id(x, y, w) == pytest.approx(f2id_of_gaussians(means, covariances, w), rel=1e-5)


def test_the_eigenvalue_form_agrees_with_the_square_root_of_a_matrix():
    rng = np.random.default_rng(5)
    a, b = (rng.normal(size=(6, 30)) for _ in range(2))
    a, b = a @ a.T, b @ b.T
    w = np.full(6, 1 / 6)
    half = sqrtm(a / 6)
    expected = np.trace(a / 6 + b / 6 - 2 * sqrtm(half @ (b / 6) @ half).real)
    found = f2id_of_gaussians((np.zeros(6), np.zeros(6)), (a, b), w)
    assert found == pytest.approx(expected, rel=1e-7)


def test_a_sample_counted_twice_is_that_sample_twice():
    rng = np.random.default_rng(1)
    x, y = rng.normal(size=(8, 5)), rng.normal(size=(6, 5))
    counts = np.array([2, 0, 1, 1, 3, 1, 0, 1.0])
    repeated = np.repeat(x, counts.astype(int), axis=0)
    found = weighted_f2id(x, y, counts, np.ones(6))
    assert found == pytest.approx(weighted_f2id(repeated, y, np.ones(9), np.ones(6)), rel=1e-10)


def test_forty_numbers_spread_over_many_points_are_forty_coordinates_again():
    rng = np.random.default_rng(2)
    _, w = midpoint_grid(64)
    spread = rng.normal(size=(10, 64))
    x, y = (flatten(rng.normal(size=(90, 4, 10)) @ spread, w) for _ in range(2))
    a, b = common_coordinates(x, y)
    assert a.shape == (90, 40)
    np.testing.assert_allclose(np.linalg.norm(a - b, axis=1), np.linalg.norm(x - y, axis=1))


@settings(derandomize=True, max_examples=30, deadline=None)
@given(st.integers(0, 10**6), st.integers(2, 9), st.integers(2, 9))
def test_order_does_not_matter_and_the_two_sets_may_change_places(seed, n, m):
    rng = np.random.default_rng(seed)
    _, w = midpoint_grid(4)
    x, y = rng.normal(size=(n, 2, 4)), rng.normal(size=(m, 2, 4))
    value = f2id(x, y, w)
    assert f2id(x[rng.permutation(n)], y[rng.permutation(m)], w) == pytest.approx(value, abs=1e-9)
    assert f2id(y, x, w) == pytest.approx(value, abs=1e-9)
    assert value >= 0
    assert f2id(x, x[rng.permutation(n)], w) == pytest.approx(0, abs=1e-9)
    assert f2id(x, x + 0.5, w) == pytest.approx(2 * 0.25, abs=1e-9)


def test_two_samples_of_one_process_stand_at_the_known_floor():
    x, w = midpoint_grid(64)
    root = np.linalg.cholesky(smooth(x, 0.2) + 1e-9 * np.eye(64))
    rng = np.random.default_rng(3)
    draws = root @ rng.normal(size=(2, 5, 64, 1000))
    floor = np.mean([f2id(a.T[:, None], b.T[:, None], w) for a, b in zip(*draws, strict=True)])
    assert 0.001 < floor < 0.007  # 0.0035 was measured in a prototype


@pytest.mark.parametrize("weights", [np.full(4, 0.5), np.full(3, 1 / 3), np.array([2, -1, 0, 0.0])])
def test_weights_must_be_a_quadrature_of_the_features_grid(weights):
    with pytest.raises(ValueError, match="weights"):
        f2id(np.zeros((3, 1, 4)), np.zeros((3, 1, 4)), weights)
