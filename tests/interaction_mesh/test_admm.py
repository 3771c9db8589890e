"""Reference: the closed form of a geometric series."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from pacmo_core.interaction_mesh.admm import (
    CHECK_EVERY,
    MAX_EXTRAPOLATION,
    REQUIRED_CHECKS,
    ConvergenceRate,
)

FIXED = settings(derandomize=True, deadline=None, max_examples=50)


def rate_after_checks(*steps: float) -> ConvergenceRate:
    """Look at a body that moved by such steps."""
    return update_rate(ConvergenceRate.initial(1), *steps)


def update_rate(rate_state: ConvergenceRate, *steps: float) -> ConvergenceRate:
    for step in steps:
        rate_state = rate_state.update(np.array([step**2]))
    return rate_state


@FIXED
@given(rate=st.floats(0.01, 1 - 1 / MAX_EXTRAPOLATION), first=st.floats(1e-6, 1e3))
def test_extrapolation_ends_where_a_geometric_series_of_steps_would(
    rate: float, first: float
) -> None:
    extrapolation, _ = rate_after_checks(first, first * rate**CHECK_EVERY).extrapolate()
    step = first * rate ** (2 * CHECK_EVERY)
    np.testing.assert_allclose(step * (1 + extrapolation), step / (1 - rate), rtol=1e-4)


def test_steps_that_grow_or_vanish_are_not_extrapolated() -> None:
    for steps in ((1.0, 2.0), (1.0, 0.0), (0.0, 0.0), (np.inf, np.inf)):
        np.testing.assert_allclose(rate_after_checks(*steps).extrapolate()[0], [0], atol=1e-3)


def test_a_body_that_oscillates_after_extrapolation_is_not_extrapolated_again() -> None:
    extrapolation, rate_state = rate_after_checks(1.0, 0.5).extrapolate()
    assert extrapolation[0] > 0
    # Steps that halve from look to look would be an eleventh after 3.5 of them: 0.044.
    assert REQUIRED_CHECKS == 3.5
    converging, converging_state = update_rate(rate_state, 0.08, 0.04).extrapolate()
    oscillating, oscillating_state = update_rate(rate_state, 0.1, 0.05).extrapolate()
    assert converging[0] > 0 and oscillating[0] == 0
    # And later not either, however steps shrink then.
    assert update_rate(converging_state, 0.006, 0.003).extrapolate()[0] > 0
    assert update_rate(oscillating_state, 0.006, 0.003).extrapolate()[0] == 0
