"""Truth: cubics, which a spline reproduces, and functions known at every instant."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import make_smoothing_spline

from pacmo_core.operators.spline import (
    MIN_FRAMES,
    SmoothingSpline,
    Spline,
    estimate_noise_variance,
    fit_smoothing_spline,
)


@settings(derandomize=True, deadline=None)
@given(st.lists(st.floats(0.01, 1.0), min_size=3, max_size=20))
def test_a_cubic_is_recovered_from_any_four_instants_or_more(gaps: list[float]) -> None:
    times = np.cumsum([2.0, *gaps])

    def cubic(t: np.ndarray) -> np.ndarray:
        return np.stack([(t - 2) ** 3 - (t - 2), 4 * t**2], axis=-1)

    at = np.linspace(times[0], times[-1], 33)
    np.testing.assert_allclose(Spline(times, cubic(times)).on_grid(33), cubic(at), atol=1e-6)


def test_two_samples_are_joined_by_a_line() -> None:
    np.testing.assert_allclose(Spline([1.0, 3.0], [0.0, 4.0])([1.5]), [1.0])


def test_a_spline_does_not_extrapolate() -> None:
    spline = Spline([0.0, 1.0, 2.0], [0.0, 1.0, 0.0])
    with pytest.raises(ValueError, match=r"\[0, 2\]"):
        spline([2.01])


def instants(n: int, seed: int, fps: float = 15.0) -> np.ndarray:
    """List frames at a rate, each up to a third of a step off."""
    return (np.arange(n) + np.random.default_rng(seed).uniform(-0.33, 0.33, n)) / fps


@settings(derandomize=True, deadline=None, max_examples=30)
@given(st.integers(5, 60), st.integers(0, 1000), st.floats(-7, 0))
def test_it_is_scipys_smoothing_spline_at_its_knots(n: int, seed: int, power: float) -> None:
    times, weight = instants(n, seed), 10.0**power
    values = np.random.default_rng(seed).normal(size=(n, 3))
    expected = make_smoothing_spline(times, values, lam=weight)(times)
    np.testing.assert_allclose(fit_smoothing_spline(times, values, weight), expected, atol=1e-7)


def test_no_weight_leaves_the_frames_and_all_of_it_a_line() -> None:
    times = instants(30, 0)
    values = np.random.default_rng(0).normal(size=(30, 2))
    np.testing.assert_array_equal(fit_smoothing_spline(times, values, 0.0), values)
    line = fit_smoothing_spline(times, values, 1e9)
    fitted = np.stack([np.polyval(np.polyfit(times, v, 1), times) for v in values.T], axis=1)
    np.testing.assert_allclose(line, fitted, atol=1e-3)


@pytest.mark.parametrize("sigma", [1e-3, 1e-2, 0.1])
def test_noise_is_found_at_its_size_beside_any_cubic(sigma: float) -> None:
    random = np.random.default_rng(1)
    times = instants(400, 1)
    cubic = 0.3 * times[:, None] ** 3 - times[:, None]
    found = estimate_noise_variance(times, cubic + sigma * random.normal(size=(400, 45)))
    assert found == pytest.approx(sigma**2, rel=0.05)


def test_clean_motion_stays_as_it_is() -> None:
    times = np.arange(120) / 30
    motion = np.sin(2 * np.pi * times)[:, None, None] * np.ones((1, 4, 3))
    kept = SmoothingSpline(times, motion.astype(np.float32))(times)
    assert np.abs(kept - motion).max() < 1e-3  # of a swing of two metres


def test_noisy_frames_come_nearer_to_the_motion_and_to_each_others() -> None:
    random = np.random.default_rng(2)
    times = np.arange(31) / 15
    truth = 0.2 * np.sin(2 * np.pi * 0.7 * times)[:, None, None] * np.ones((1, 15, 3))
    frames = (truth + 0.02 * random.normal(size=truth.shape)).astype(np.float32)
    smooth = SmoothingSpline(times, frames)(times)
    assert np.square(smooth - truth).mean() < 0.6 * np.square(frames - truth).mean()
    # The splines of every second frame, both of the motion between them.
    inner = np.linspace(times[1], times[-2], 50)
    apart, before = (
        np.square(spline(times[::2], frames[::2])(inner) - spline(times[1::2], frames[1::2])(inner))
        for spline in (SmoothingSpline, Spline)
    )
    assert apart.mean() < 0.75 * before.mean()


def test_too_few_frames_are_left_alone() -> None:
    motion = np.random.default_rng(3).normal(size=(MIN_FRAMES - 1, 2, 3)).astype(np.float32)
    times = np.arange(MIN_FRAMES - 1) / 15
    inner = np.linspace(0, times[-1], 20)
    np.testing.assert_array_equal(
        SmoothingSpline(times, motion)(inner), Spline(times, motion)(inner)
    )
