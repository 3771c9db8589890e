"""Truth: a thing that is carried, handed over and carried away by somebody else."""

import numpy as np
import pytest

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.formats.table import RELEASED, while_held

BODY = Skeleton("body", ("hip", "left_hand", "right_hand"), (-1, 0, 0), ((1, 2),))
N, LAST = 40, 24  # frames, and the last in which it is held
OFFSET = np.array([0.0, 0.1, 0.2])


def carried(unit: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a motion whose right hand carries a thing, which then goes the other way."""
    times = np.linspace(0, 1, N)[:, None]
    hip = np.zeros((N, 3))
    right = np.concatenate([0.3 + times, 1 + 0 * times, times**2], axis=1)
    motion = np.stack([hip, right - [0.9, 0, 0], right], axis=1)
    place = right + OFFSET
    place[LAST + 1 :] += np.linspace(0.5, 2, N - LAST - 1)[:, None] * [1, 0, 0]
    return place / unit, motion / unit


@pytest.mark.parametrize("unit", [1.0, 0.001])
def test_a_thing_that_is_handed_over_stays_in_the_hand_that_held_it(unit: float) -> None:
    place, motion = carried(unit)
    found = while_held(place, motion, BODY, unit)
    np.testing.assert_allclose(found * unit, motion[:, 2] * unit + OFFSET, atol=1e-9)
    np.testing.assert_array_equal(found[: LAST + 1], place[: LAST + 1])


def test_where_it_goes_then_changes_nothing() -> None:
    place, motion = carried(1.0)
    other = place.copy()
    other[LAST + 1 :] += np.random.default_rng(0).uniform(0.5, 1, (N - LAST - 1, 3))
    first, second = (while_held(one, motion, BODY, 1.0) for one in (place, other))
    np.testing.assert_array_equal(first, second)


def test_a_thing_that_is_kept_or_comes_back_is_where_it_is() -> None:
    place, motion = carried(1.0)
    kept = motion[:, 2] + OFFSET + 0.4 * RELEASED
    np.testing.assert_array_equal(while_held(kept, motion, BODY, 1.0), kept)
    back = place.copy()
    back[-1] = motion[-1, 2] + OFFSET
    np.testing.assert_array_equal(while_held(back, motion, BODY, 1.0), back)
