"""Trusted: the discrepancy of two Gaussians in closed form, and plain loops over pairs."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pacmo_core.metrics.mmd import (
    PUBLISHED_BANDWIDTHS,
    as_sequence,
    mean_kernels,
    median_bandwidth,
    mmd_a,
    mmd_a_published,
    mmd_s,
    mmd_s_published,
    published_statistic,
)

SHIFT = np.eye(6)[0]
EXACT = 2 * (10 / 14) ** 3 * (1 - np.exp(-1 / 14))


def codes(n, m=0):
    return np.arange(m, m + n)


def two_gaussians(n, seed):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(n, 1, 6)), SHIFT + rng.normal(size=(n, 1, 6))


def test_the_unbiased_form_averages_to_the_closed_form():
    assert pytest.approx(0.050246, abs=1e-6) == EXACT
    found = [
        mmd_s(*two_gaussians(300, seed), codes(300), codes(300, 300), bandwidth=10.0)
        for seed in range(8)
    ]
    standard_error = np.std(found, ddof=1) / np.sqrt(8)
    assert abs(np.mean(found) - EXACT) < 4 * standard_error < 0.015


def test_the_published_form_adds_the_pairs_of_a_motion_with_itself():
    n, excess = 200, 2 / 200 * (1 - (10 / 14) ** 3)
    gaps = []
    for seed in range(6):
        x, y = two_gaussians(n, seed)
        kernels = [mean_kernels(a, b, np.array([10.0])) for a, b in ((x, x), (y, y), (x, y))]
        biased = published_statistic(kernels, np.ones(n), np.ones(n))
        gaps.append(biased - mmd_s(x, y, codes(n), codes(n, n), bandwidth=10.0))
    assert np.mean(gaps) == pytest.approx(excess, rel=0.05)


def loop_discrepancy(x, y, bandwidth, x_clips, y_clips):
    def mean(a, b, i, j):
        pairs = [(p, q) for p in range(len(a)) for q in range(len(b)) if i[p] != j[q]]
        return np.mean([np.exp(-((a[p] - b[q]) ** 2).sum() / bandwidth) for p, q in pairs])

    within = mean(x, x, x_clips, x_clips) + mean(y, y, y_clips, y_clips)
    return within - 2 * mean(x, y, x_clips, y_clips)


def test_unbiased_values_are_those_of_a_loop_over_frames_and_pairs():
    rng = np.random.default_rng(0)
    x, y = rng.normal(size=(6, 3, 2)), 0.5 + rng.normal(size=(5, 3, 2))
    i, j = np.array([0, 0, 1, 1, 2, 2]), np.array([0, 1, 2, 3, 3])
    by_frame = [loop_discrepancy(x[:, t], y[:, t], 3.0, i, j) for t in range(3)]
    assert mmd_a(x, y, i, j, bandwidth=3.0) == pytest.approx(np.mean(by_frame), abs=1e-12)
    whole = loop_discrepancy(x.reshape(6, -1), y.reshape(5, -1), 3.0, i, j)
    assert mmd_s(x, y, i, j, bandwidth=3.0) == pytest.approx(whole, abs=1e-12)


def test_published_values_are_the_mean_of_running_maxima_of_a_loop():
    rng = np.random.default_rng(1)
    x, y = rng.normal(size=(5, 4, 2)), 1 + rng.normal(size=(5, 4, 2))

    def biased(a, b, bandwidth):
        values = 0.0
        for p in range(5):
            for q in range(5):
                for s, u, v in ((1, a[p], a[q]), (1, b[p], b[q]), (-2, a[p], b[q])):
                    values += s * np.exp(-((u - v) ** 2).sum() / bandwidth)
        return values / 25

    def running(at):
        best, maxima = -np.inf, []
        for bandwidth in (10.0**k for k in range(-4, 10)):
            best = max(best, at(bandwidth))
            maxima.append(best)
        return np.mean(maxima)

    frames = running(lambda b: np.mean([biased(x[:, t], y[:, t], b) for t in range(4)]))
    assert mmd_a_published(x, y) == pytest.approx(frames, abs=1e-9)
    assert mmd_s_published(x, y) == pytest.approx(running(lambda b: biased(x, y, b)), abs=1e-9)
    assert len(PUBLISHED_BANDWIDTHS) == 14


@pytest.mark.parametrize("n", [50, 120])
@pytest.mark.parametrize("measure", [mmd_a_published, mmd_s_published])
def test_the_published_form_never_falls_below_two_over_n_for_different_motions(n, measure):
    rng = np.random.default_rng(n)
    x, y = rng.normal(size=(2, n, 8, 6))
    value = measure(x, y)
    assert 2 / n * (1 - 1e-6) <= value < 1.2 * 2 / n
    assert measure(x, x[::-1]) == pytest.approx(0, abs=1e-9)


@settings(derandomize=True, max_examples=25, deadline=None)
@given(st.integers(0, 10**6))
def test_order_symmetry_and_a_common_rigid_motion_leave_it_alone(seed):
    rng = np.random.default_rng(seed)
    x, y = rng.normal(size=(2, 7, 4, 6))
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    moved = [(a.reshape(7, 4, 2, 3) @ turn + 5).reshape(7, 4, 6) for a in (x, y)]
    i, j = codes(7), codes(7, 7)
    for measure in (mmd_a, mmd_s):
        value = measure(x, y, i, j, bandwidth=4.0)
        assert measure(x[::-1], y, i, j, bandwidth=4.0) == pytest.approx(value, abs=1e-12)
        assert measure(y, x, j, i, bandwidth=4.0) == pytest.approx(value, abs=1e-12)
        assert measure(*moved, i, j, bandwidth=4.0) == pytest.approx(value, abs=1e-12)
    for published in (mmd_a_published, mmd_s_published):
        assert published(*moved) == pytest.approx(published(x, y), abs=1e-8)


def test_a_set_against_itself_permuted_is_zero_where_clips_go_with_the_motions():
    rng = np.random.default_rng(4)
    x, order, clips = rng.normal(size=(8, 3, 6)), rng.permutation(8), np.arange(8) // 2
    assert mmd_a(x, x[order], clips, clips[order], bandwidth=2.0) == pytest.approx(0, abs=1e-12)


def test_the_median_bandwidth_goes_with_the_square_of_the_unit():
    x = np.random.default_rng(6).normal(size=(9, 3, 6))
    assert median_bandwidth(3 * x) == pytest.approx(9 * median_bandwidth(x))
    assert median_bandwidth(np.array([[[0.0]], [[1.0]], [[3.0]]])) == pytest.approx(2 * 4)
    assert as_sequence(x).shape == (9, 1, 18)
    with pytest.raises(ValueError, match="alike"):
        median_bandwidth(np.zeros((4, 2, 3)))


def test_one_clip_alone_has_no_unbiased_value():
    with pytest.raises(ValueError, match="two clips"):
        mmd_a(np.zeros((2, 1, 1)), np.ones((2, 1, 1)), codes(2) * 0, codes(2) * 0, bandwidth=1.0)
