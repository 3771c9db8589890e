"""Truth: a handful of clips whose order is plain to see."""

import numpy as np
import pytest

from pacmo_core.augmentation.choose import Candidate, choose, nearness_of
from pacmo_core.data.interaction import Interaction
from pacmo_core.data.skeleton import SBU15

CLIPS = [
    Candidate("a#0", "a", "dance", 1.0),
    Candidate("a#1", "a", "dance", 9.0),
    Candidate("b", "b", "dance", 5.0),
    Candidate("c#0", "c", "push", 0.5),
    Candidate("c#1", "c", "push", 0.5),
]


def test_the_nearest_window_of_each_sequence_is_taken_the_first_of_equals() -> None:
    assert choose(CLIPS, of_each_sequence=1, most=None) == ["a#1", "b", "c#0"]


def test_every_act_is_there_before_a_second_of_any() -> None:
    assert choose(CLIPS, of_each_sequence=1, most=2) == ["a#1", "c#0"]
    assert choose(CLIPS, of_each_sequence=None, most=3) == ["a#1", "b", "c#0"]
    assert choose(CLIPS, of_each_sequence=None, most=None) == [c.clip for c in CLIPS]


def test_nearness_counts_the_pairs_of_joints_that_are_near() -> None:
    points = np.zeros((2, 4, 15, 3), np.float32)
    points[0, ..., 0] = 10 * np.arange(15)
    points[1] = points[0] + np.float32([0, 0.2, 0])
    points[1, 0] += 50  # the first of four frames is far
    clip = Interaction(SBU15, np.arange(4) / 30, *points)
    assert nearness_of(clip, 0.25) == pytest.approx(15 * 3 / 4)
