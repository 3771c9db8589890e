"""Truth: bodies that touch or do not by construction, and the order in which they are looked at."""

from collections.abc import Iterator

import numpy as np
import pytest

from benchmarks.touching import Row, captured_touch
from pacmo_core.api import synthesise
from pacmo_core.data.interaction import Motion
from pacmo_core.metrics.touching import TouchName

CLIP = synthesise(10)["handshake-1"]
AWAY = CLIP.person_b + np.array([5, 0, 0], np.float32)


def test_a_captured_handshake_is_told_as_one_of_right_hands() -> None:
    assert captured_touch(CLIP) == TouchName.right_hands


@pytest.mark.parametrize(
    ("name", "drawn", "told"), [(TouchName.right_hands, 3, 2), (TouchName.no_hands, 1, 0)]
)
def test_the_first_that_touches_as_told_is_taken(name: TouchName, drawn: int, told: int) -> None:
    motions = [AWAY[None], AWAY[None] + 1, CLIP.person_b[None], CLIP.person_b[None] + 0.001]
    row = Row()
    row.add(CLIP, iter(motions), name)
    assert (row.found, row.drawn) == ([True], [drawn])
    np.testing.assert_array_equal(row.untold[0][1], motions[0])
    np.testing.assert_array_equal(row.told[0][1], motions[told])


def test_where_none_touches_as_told_the_first_stays() -> None:
    def candidates() -> Iterator[Motion]:
        yield from (AWAY[None] + number for number in range(4))

    row = Row()
    row.add(CLIP, candidates(), TouchName.body)
    assert (row.found, row.drawn) == ([False], [4])
    np.testing.assert_array_equal(row.told[0][1], AWAY[None])
