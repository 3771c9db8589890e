"""Trusted: a foot on the ground does not move, and a body that stands still takes no step."""

from itertools import pairwise

import numpy as np
import pytest

from pacmo_core.synthesis.choreography import RootMove, root_path
from pacmo_core.synthesis.gait import SWING_SHARE, Gait, plan_steps, sample_footsteps

GAIT = Gait(
    step_time=0.5,
    phase=0.3,
    first=0,
    stance=0.1,
    stagger=0.0,
    toe_out=0.1,
    lead=0.1,
    clearance=0.07,
)
TIMES = np.linspace(0, 4, 1201)
WALK = root_path((0.0, -3.0, 0.0), RootMove(0.3, 3.0, z=2.5))


def test_feet_on_the_ground_do_not_slide() -> None:
    feet = sample_footsteps(WALK, GAIT, TIMES, 4.0)
    for side in range(2):
        down = (feet.air[side, 1:] == 0) & (feet.air[side, :-1] == 0)
        assert down.mean() > 0.4
        assert np.abs(np.diff(feet.toes[side], axis=0))[down].max() == 0
        assert feet.toes[side, feet.air[side] == 0, 1].max() == 0


def test_one_foot_is_always_on_the_ground() -> None:
    feet = sample_footsteps(WALK, GAIT, TIMES, 4.0)
    assert (feet.air.min(axis=0) == 0).all()


def test_steps_alternate_and_are_as_long_as_the_pace_asks() -> None:
    plants = plan_steps(WALK, GAIT, 4.0)
    starts = sorted((t, side) for side in range(2) for t, _ in plants[side][1:])
    sides = [side for _, side in starts]
    assert all(a != b for a, b in pairwise(sides))
    strides = np.concatenate([np.diff([place[1] for _, place in foot]) for foot in plants])
    pace = 2.5 / (2.7 - 0.45)
    assert strides.max() == pytest.approx(2 * GAIT.step_time * pace, rel=0.05)
    assert SWING_SHARE < 1


def test_feet_end_under_the_body() -> None:
    feet = sample_footsteps(WALK, GAIT, TIMES, 4.0)
    middle = feet.toes[:, -1].mean(axis=0)
    assert middle[[0, 2]] == pytest.approx([0.0, -0.5 + GAIT.lead], abs=0.06)


def test_who_stands_takes_no_step() -> None:
    assert [len(foot) for foot in plan_steps(root_path((0.0, -1.0, 0.0)), GAIT, 4.0)] == [1, 1]


def test_who_turns_on_the_spot_steps_round() -> None:
    feet = sample_footsteps(
        root_path((0.0, 0.0, 0.0), RootMove(0.5, 1.8, yaw=np.pi)), GAIT, TIMES, 4.0
    )
    assert feet.yaw[:, -1].mean() == pytest.approx(np.pi, abs=0.15)
