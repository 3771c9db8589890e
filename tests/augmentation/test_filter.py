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
    contacts_kept=0.9,
    capsule_penetration=0.01,
    knee_change_p95=30,
    elbow_change_p95=60,
    spine_change_p95=40,
    pelvis_height_error=0.1,
    support_height_error=0.02,
    spine_bend=20,
    trunk_change=0.5,
    below_floor=0.01,
    added_foot_skate=0.01,
    peak_acceleration_ratio=1.5,
    seam_ratio=2.0,
    knee_flips=0.0,
    elbow_flips=0.02,
)
GOOD = {
    "primal_residual": 0.001,
    "contacts_kept": 0.95,
    "capsule_penetration": 0.01,
    "knee_change_p95": 3.0,
    "elbow_change_p95": 20.0,
    "spine_change_p95": 2.0,
    "pelvis_height_error": 0.02,
    "support_height_error": 0.01,
    "spine_bend": 4.0,
    "trunk_change": 0.1,
    "below_floor": 0.0,
    "added_foot_skate": -0.001,
    "peak_acceleration_ratio": 1.2,
    "seam_ratio": 1.1,
    "knee_flips": 0.0,
    "elbow_flips": 0.0,
}


def test_a_variation_at_its_limits_is_accepted() -> None:
    assert exceeded_limits(GOOD, LIMITS) == {}
    assert rejection_reason(GOOD, LIMITS) == ""
    assert max_limit_ratio(GOOD, LIMITS) == 1


def test_exceeded_limits_are_listed_largest_ratio_first() -> None:
    bad = GOOD | {"contacts_kept": 0.7, "peak_acceleration_ratio": 3.0}
    assert exceeded_limits(bad, LIMITS) == pytest.approx(
        {"contacts_kept": 3.0, "peak_acceleration_ratio": 2.0}
    )
    assert rejection_reason(bad, LIMITS) == (
        "contacts_kept 0.7, wanted at least 0.9; peak_acceleration_ratio 3, wanted at most 1.5"
    )
    assert max_limit_ratio(bad, LIMITS) == pytest.approx(3.0)


def test_nan_exceeds_every_limit() -> None:
    broken = GOOD | {"primal_residual": nan}
    assert list(exceeded_limits(broken, LIMITS)) == ["primal_residual"]
    assert max_limit_ratio(broken, LIMITS) == inf
    assert "primal_residual nan" in rejection_reason(broken, LIMITS)


def test_a_limit_of_zero_accepts_zero_only() -> None:
    strict = replace(LIMITS, capsule_penetration=0.0, contacts_kept=1.0)
    assert set(exceeded_limits(GOOD, strict)) == {"capsule_penetration", "contacts_kept"}
    assert exceeded_limits(GOOD | {"capsule_penetration": 0.0, "contacts_kept": 1.0}, strict) == {}
