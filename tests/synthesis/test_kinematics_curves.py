"""Trusted: the definition of each curve by its ends, its derivatives and its bounds."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pacmo_core.synthesis.kinematics import (
    bump,
    ease_in_out,
    minimum_jerk,
    soft_max,
    soft_min,
    sum_of_sines,
)

X = np.linspace(-0.5, 1.5, 4001)


def test_minimum_jerk_starts_and_ends_at_rest_with_no_force() -> None:
    y = minimum_jerk(X)
    speed, force = np.gradient(y, X), np.gradient(np.gradient(y, X), X)
    assert y[X <= 0].max() == 0
    assert y[X >= 1].min() == 1
    for end in (0.0, 1.0):
        near = np.abs(X - end) < 2e-3
        assert np.abs(speed[near]).max() < 1e-3
        assert np.abs(force[near]).max() < 0.2
    # The fifth-order polynomial of least jerk has its greatest speed, 15/8, half way.
    assert speed.max() == pytest.approx(1.875, rel=1e-4)


@settings(derandomize=True, max_examples=50)
@given(start=st.floats(-2, 2), length=st.floats(0.2, 3), ease=st.floats(0.05, 2))
def test_a_glide_goes_from_0_to_1_and_never_back(start: float, length: float, ease: float) -> None:
    times = np.linspace(start - 1, start + length + 1, 800)
    y = ease_in_out(times, start, start + length, ease)
    assert np.abs(y[times <= start]).max() < 1e-9
    assert np.abs(y[times >= start + length] - 1).max() < 1e-9
    assert np.diff(y).min() > -1e-12


def test_a_glide_keeps_its_pace_between_the_eases() -> None:
    times = np.linspace(0.5, 1.5, 50)
    assert np.gradient(ease_in_out(times, 0.0, 2.0, 0.4), times) == pytest.approx(1 / 1.6, rel=1e-9)


def test_a_bump_is_highest_half_way() -> None:
    assert bump(np.array([-1.0, 0.0, 0.5, 1.0, 2.0])).tolist() == [0, 0, 1, 0, 0]


@settings(derandomize=True, max_examples=50)
@given(a=st.floats(-1, 1), b=st.floats(-1, 1))
def test_soft_bounds_are_bounds(a: float, b: float) -> None:
    low, high = float(soft_min(np.array(a), b, 0.01)), float(soft_max(np.array(a), b, 0.01))
    assert min(a, b) - 0.01 * np.log(2) - 1e-12 <= low <= min(a, b) + 1e-12
    assert max(a, b) - 1e-12 <= high <= max(a, b) + 0.01 * np.log(2) + 1e-12


def test_drift_has_variance_one() -> None:
    random = np.random.default_rng(0)
    phases, rates = random.uniform(0, 2 * np.pi, (4000, 3)), random.uniform(0.1, 0.7, (4000, 3))
    assert sum_of_sines(np.array([0.0, 1.3]), phases, rates).var(axis=0) == pytest.approx(
        1.0, abs=0.06
    )
