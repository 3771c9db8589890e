"""Truth: a handful of clips whose order is plain to see."""

from dataclasses import replace
from math import inf, nan

import numpy as np
import pytest

from pacmo_core.augmentation.filter import (
    Candidate,
    VariationLimits,
    exceeded_limits,
    max_limit_ratio,
    mean_near_pairs,
    rejection_reason,
    select_clips,
)
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
    assert select_clips(CLIPS, of_each_sequence=1, most=None) == ["a#1", "b", "c#0"]


def test_every_act_is_there_before_a_second_of_any() -> None:
    assert select_clips(CLIPS, of_each_sequence=1, most=2) == ["a#1", "c#0"]
    assert select_clips(CLIPS, of_each_sequence=None, most=3) == ["a#1", "b", "c#0"]
    assert select_clips(CLIPS, of_each_sequence=None, most=None) == [c.clip for c in CLIPS]


def test_nearness_counts_the_pairs_of_joints_that_are_near() -> None:
    points = np.zeros((2, 4, 15, 3), np.float32)
    points[0, ..., 0] = 10 * np.arange(15)
    points[1] = points[0] + np.float32([0, 0.2, 0])
    points[1, 0] += 50  # the first of four frames is far
    clip = Interaction(SBU15, np.arange(4) / 30, *points)
    assert mean_near_pairs(clip, 0.25) == pytest.approx(15 * 3 / 4)


# FROM """Truth: limits written down here."""
BOUNDS = VariationLimits(
    raw_residual=0.01,
    contacts_kept=0.9,
    added_slide=0.01,
    penetration=0.01,
    seam_ratio=1.5,
    flip_share=0.02,
    trunk_change=0.5,
)
GOOD = {
    "raw_residual": 0.001,
    "contacts_kept": 0.95,
    "added_slide": -0.001,
    "penetration": 0.01,
    "seam_ratio": 1.2,
    "flip_share": 0.0,
    "trunk_change": 0.1,
}


def test_a_variation_at_its_limits_is_good() -> None:
    assert exceeded_limits(GOOD, BOUNDS) == {}
    assert rejection_reason(GOOD, BOUNDS) == ""
    assert max_limit_ratio(GOOD, BOUNDS) == 1


def test_what_is_beyond_a_limit_is_said_the_worst_first() -> None:
    bad = GOOD | {"contacts_kept": 0.7, "seam_ratio": 3.0}
    assert exceeded_limits(bad, BOUNDS) == pytest.approx({"contacts_kept": 3.0, "seam_ratio": 2.0})
    assert rejection_reason(bad, BOUNDS) == (
        "contacts_kept 0.7, wanted at least 0.9; seam_ratio 3, wanted at most 1.5"
    )
    assert max_limit_ratio(bad, BOUNDS) == pytest.approx(3.0)


def test_what_is_no_number_is_beyond_its_limit() -> None:
    broken = GOOD | {"raw_residual": nan}
    assert list(exceeded_limits(broken, BOUNDS)) == ["raw_residual"]
    assert max_limit_ratio(broken, BOUNDS) == inf
    assert "raw_residual nan" in rejection_reason(broken, BOUNDS)


def test_a_limit_of_nothing_lets_nothing_through() -> None:
    strict = replace(BOUNDS, penetration=0.0, contacts_kept=1.0)
    assert set(exceeded_limits(GOOD, strict)) == {"penetration", "contacts_kept"}
    assert exceeded_limits(GOOD | {"penetration": 0.0, "contacts_kept": 1.0}, strict) == {}
