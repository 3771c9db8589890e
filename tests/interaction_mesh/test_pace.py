"""A long step goes to where a geometric series ends: its closed form is trusted."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from pacmo_core.interaction_mesh.solve import EVERY, LONGEST, Pace

FIXED = settings(derandomize=True, deadline=None, max_examples=50)


@FIXED
@given(rate=st.floats(0.01, 1 - 1 / LONGEST), first=st.floats(1e-6, 1e3))
def test_a_long_step_ends_where_shrinking_ones_would(rate: float, first: float) -> None:
    pace = Pace(*np.ones((2, 1)))
    for look in range(2):
        pace = pace.after(np.array([(first * rate ** (look * EVERY)) ** 2]))
    step = first * rate ** (2 * EVERY)
    np.testing.assert_allclose(step * (1 + pace.beyond()), step / (1 - rate), rtol=1e-4)


def test_steps_that_grow_or_end_are_no_reason_to_go_astray() -> None:
    pace = Pace(*np.ones((2, 4))).after(np.array([1.0, 1.0, 0.0, np.inf]))
    pace = pace.after(np.array([4.0, 0.0, 0.0, np.inf]))
    np.testing.assert_allclose(pace.beyond(), [0, 0, 0, 0], atol=1e-3)
