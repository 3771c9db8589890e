"""Reference: a few clips with an obvious order, and limits written down here."""

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


def test_the_clip_with_most_near_pairs_of_each_sequence_is_selected() -> None:
    assert select_clips(CLIPS, max_per_sequence=1, max_clips=None) == ["a#1", "b", "c#0"]


def test_one_clip_of_each_action_is_selected_before_a_second_of_any() -> None:
    assert select_clips(CLIPS, max_per_sequence=1, max_clips=2) == ["a#1", "c#0"]
    assert select_clips(CLIPS, max_per_sequence=None, max_clips=3) == ["a#1", "b", "c#0"]
    assert select_clips(CLIPS, max_per_sequence=None, max_clips=None) == [c.clip for c in CLIPS]


def test_mean_near_pairs_counts_near_pairs_per_frame() -> None:
    points = np.zeros((2, 4, 15, 3), np.float32)
    points[0, ..., 0] = 10 * np.arange(15)
    points[1] = points[0] + np.float32([0, 0.2, 0])
    points[1, 0] += 50  # the first of four frames is far
    clip = Interaction(SBU15, np.arange(4) / 30, *points)
    assert mean_near_pairs(clip, 0.25) == pytest.approx(15 * 3 / 4)


LIMITS = VariationLimits(
    primal_residual=0.01,
    contacts_preserved=0.9,
    added_foot_skate=0.01,
    penetration=0.01,
    acceleration_peak_ratio=1.5,
    bend_flip_fraction=0.02,
    trunk_deformation=0.5,
)
GOOD = {
    "primal_residual": 0.001,
    "contacts_preserved": 0.95,
    "added_foot_skate": -0.001,
    "penetration": 0.01,
    "acceleration_peak_ratio": 1.2,
    "bend_flip_fraction": 0.0,
    "trunk_deformation": 0.1,
}


def test_a_variation_at_its_limits_is_accepted() -> None:
    assert exceeded_limits(GOOD, LIMITS) == {}
    assert rejection_reason(GOOD, LIMITS) == ""
    assert max_limit_ratio(GOOD, LIMITS) == 1


def test_exceeded_limits_are_listed_largest_ratio_first() -> None:
    bad = GOOD | {"contacts_preserved": 0.7, "acceleration_peak_ratio": 3.0}
    assert exceeded_limits(bad, LIMITS) == pytest.approx(
        {"contacts_preserved": 3.0, "acceleration_peak_ratio": 2.0}
    )
    assert rejection_reason(bad, LIMITS) == (
        "contacts_preserved 0.7, wanted at least 0.9; acceleration_peak_ratio 3, wanted at most 1.5"
    )
    assert max_limit_ratio(bad, LIMITS) == pytest.approx(3.0)


def test_nan_exceeds_every_limit() -> None:
    broken = GOOD | {"primal_residual": nan}
    assert list(exceeded_limits(broken, LIMITS)) == ["primal_residual"]
    assert max_limit_ratio(broken, LIMITS) == inf
    assert "primal_residual nan" in rejection_reason(broken, LIMITS)


def test_a_limit_of_zero_accepts_zero_only() -> None:
    strict = replace(LIMITS, penetration=0.0, contacts_preserved=1.0)
    assert set(exceeded_limits(GOOD, strict)) == {"penetration", "contacts_preserved"}
    assert exceeded_limits(GOOD | {"penetration": 0.0, "contacts_preserved": 1.0}, strict) == {}
