"""Truth: cubics, which a spline reproduces, and functions known at every instant."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pacmo_core.operators.encode import Spline


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
