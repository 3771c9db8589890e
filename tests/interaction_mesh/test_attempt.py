"""Which attempt's motion is used: the later, unless it has diverged and is worse."""

from dataclasses import replace

import numpy as np
import pytest

from pacmo_core.interaction_mesh.attempt import AttemptResult, Quality, _select_better
from pacmo_core.interaction_mesh.settings import AttemptLimits

LIMITS = AttemptLimits(
    primal_residual=0.01,
    contacts_kept=0.95,
    capsule_penetration=0.02,
    trunk_change=0.2,
    spine_bend=26,
    seam_ratio=1.5,
)
WITHIN = Quality(
    attempt=0,
    iterations=9,
    fixed_point_residual=0.001,
    primal_residual=0.005,
    contacts_kept=1.0,
    capsule_penetration=0.0,
    trunk_change=0.1,
    spine_bend=10,
    seam_ratio=1.1,
)


def result(quality: Quality) -> AttemptResult:
    """Give a result whose motion is the number of its attempt."""
    nothing = np.zeros((1, 1, 3), np.float32)
    return AttemptResult(
        motion=np.full((1, 1, 3), float(quality.attempt)),
        quality=quality,
        has_diverged=quality.has_diverged(LIMITS),
        displacement=nothing,
        bones=nothing,
        bone_forces=nothing,
    )


def used(before: Quality, after: Quality) -> float:
    """Return the number of the attempt whose motion is used."""
    chosen = _select_better(LIMITS, result(before), result(replace(after, attempt=2)))
    assert chosen.quality.attempt == chosen.motion[0, 0, 0]
    return float(chosen.motion[0, 0, 0])


def test_the_excess_is_the_sum_of_what_is_beyond_the_limits() -> None:
    assert WITHIN.excess(LIMITS) == 0
    beyond = replace(WITHIN, spine_bend=52, contacts_kept=0.85)  # twice and three times the limit
    assert beyond.excess(LIMITS) == pytest.approx(1 + 2)


def test_a_later_attempt_that_has_not_diverged_is_used_even_if_it_is_worse() -> None:
    assert used(WITHIN, replace(WITHIN, spine_bend=100)) == 2


def test_a_diverged_attempt_does_not_replace_a_better_one() -> None:
    assert used(WITHIN, replace(WITHIN, primal_residual=0.02)) == 0


def test_a_spine_that_folds_does_not_win_by_the_largest_ratio() -> None:
    folded = replace(WITHIN, spine_bend=105, contacts_kept=0.83, trunk_change=0.54)
    unset = replace(WITHIN, contacts_kept=0.78, seam_ratio=2.1)  # 4.4 times, the largest of both
    assert used(folded, unset) == 2
