"""A long step goes to where a geometric series ends: its closed form is trusted."""

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


def looked(*steps: float) -> ConvergenceRate:
    """Look at a body that moved by such steps."""
    return after(ConvergenceRate.initial(1), *steps)


def after(pace: ConvergenceRate, *steps: float) -> ConvergenceRate:
    for step in steps:
        pace = pace.update(np.array([step**2]))
    return pace


@FIXED
@given(rate=st.floats(0.01, 1 - 1 / MAX_EXTRAPOLATION), first=st.floats(1e-6, 1e3))
def test_a_long_step_ends_where_shrinking_ones_would(rate: float, first: float) -> None:
    longer, _ = looked(first, first * rate**CHECK_EVERY).extrapolate()
    step = first * rate ** (2 * CHECK_EVERY)
    np.testing.assert_allclose(step * (1 + longer), step / (1 - rate), rtol=1e-4)


def test_steps_that_grow_or_end_are_no_reason_to_go_astray() -> None:
    for steps in ((1.0, 2.0), (1.0, 0.0), (0.0, 0.0), (np.inf, np.inf)):
        np.testing.assert_allclose(looked(*steps).extrapolate()[0], [0], atol=1e-3)


def test_a_body_that_a_long_step_set_swinging_takes_no_other() -> None:
    longer, pace = looked(1.0, 0.5).extrapolate()
    assert longer[0] > 0
    # Steps that halve from look to look would be an eleventh after 3.5 of them: 0.044.
    assert REQUIRED_CHECKS == 3.5
    paid, going_on = after(pace, 0.08, 0.04).extrapolate()
    swings, ended = after(pace, 0.1, 0.05).extrapolate()
    assert paid[0] > 0 and swings[0] == 0
    # And later not either, however steps shrink then.
    assert after(going_on, 0.006, 0.003).extrapolate()[0] > 0
    assert after(ended, 0.006, 0.003).extrapolate()[0] == 0
