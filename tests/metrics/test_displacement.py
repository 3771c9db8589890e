"""Trusted: errors of motions that differ by an offset or a factor, by hand."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pacmo_core.metrics.displacement import ape, ave, position_errors, variance_errors
from tests.metrics.problems import motions


def test_a_constant_offset_is_all_position_and_no_variance():
    real = motions(4, np.random.default_rng(0))
    moved = [m + np.array([0, 0.3, 0.4]) for m in real]
    np.testing.assert_allclose(ape(moved, real, weighting="sequence"), 0.5, rtol=1e-12)
    np.testing.assert_allclose(ave(moved, real, weighting="sequence"), 0, atol=1e-12)


@pytest.mark.parametrize("frames", [12, 50])
def test_a_sine_of_twice_the_size_errs_by_three_halves_with_the_unbiased_variance(frames):
    wave = np.zeros((frames, 2, 3))
    wave[:, 0, 0] = np.sin(2 * np.pi * 3 * np.arange(frames) / frames)
    found = ave([2 * wave], [wave], weighting="sequence")
    np.testing.assert_allclose(found, [1.5 * frames / (frames - 1), 0], atol=1e-12)


def test_a_long_sequence_weighs_as_much_as_a_short_one_or_as_its_frames():
    real = [np.zeros((10, 1, 3)), np.zeros((30, 1, 3))]
    moved = [real[0] + np.array([1, 0, 0]), real[1] + np.array([3, 0, 0])]
    assert ape(moved, real, weighting="sequence")[0] == pytest.approx(2.0)
    assert ape(moved, real, weighting="frame")[0] == pytest.approx(2.5)


def test_errors_are_those_of_a_loop():
    rng = np.random.default_rng(1)
    real, made = motions(3, rng, shortest=6, longest=6), motions(3, rng, shortest=6, longest=6)
    for i in range(3):
        for j in range(3):
            a, b = made[i][:, j].astype(float), real[i][:, j].astype(float)
            distance = sum(np.sqrt(((p - q) ** 2).sum()) for p, q in zip(a, b, strict=True)) / 6
            gap = ((a - a.mean(0)) ** 2).sum(0) / 5 - ((b - b.mean(0)) ** 2).sum(0) / 5
            assert position_errors(made, real)[i, j] == pytest.approx(distance)
            assert variance_errors(made, real)[i, j] == pytest.approx(np.sqrt((gap**2).sum()))


@settings(derandomize=True, max_examples=20, deadline=None)
@given(st.integers(0, 10**6))
def test_position_error_does_not_change_when_both_are_moved_and_turned(seed):
    rng = np.random.default_rng(seed)
    real, made = rng.normal(size=(2, 1, 5, 2, 3))
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    np.testing.assert_allclose(
        position_errors(list(made @ turn + 2), list(real @ turn + 2)),
        position_errors(list(made), list(real)),
    )
    np.testing.assert_allclose(
        variance_errors(list(made + 2), list(real - 1)), variance_errors(list(made), list(real))
    )


def test_motions_at_other_times_are_refused():
    real = motions(1, np.random.default_rng(2), shortest=6, longest=6)
    with pytest.raises(ValueError, match=r"motion 0: .* got \(5, 3, 3\), \(6, 3, 3\)"):
        ape([real[0][:5]], real, weighting="sequence")
    with pytest.raises(ValueError, match="got 0, 1"):
        ape([], real, weighting="sequence")
    with pytest.raises(ValueError, match="weighting"):
        ape(real, real, weighting="clip")
