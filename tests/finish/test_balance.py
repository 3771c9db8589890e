"""Truth: bodies at known distances from feet that stand."""

import numpy as np
import pytest

from pacmo_core.data.skeleton import SBU15
from pacmo_core.finish.balance import MAX_LEAN, MAX_LEAN_WALKING, keep_over_feet
from pacmo_core.finish.bones import leg_joints, leg_length, median_lengths
from tests.reaction.problems import REST
from tests.strategies import SMALL

FPS = 30.0
LENGTHS = median_lengths(REST[None].astype(np.float32), SBU15)
MOST = MAX_LEAN * leg_length(LENGTHS, SBU15)
LEGS = leg_joints(SBU15)
FEET = SBU15.indices(["left_foot", "right_foot"])
BODY = [joint for joint in range(len(SBU15.joints)) if joint not in LEGS]
BOTH, LEFT = np.ones((2, 90), bool), np.array([[True] * 90, [False] * 90])


def leaning(ahead: float, aside: float = 0.0) -> np.ndarray:
    """Stand for three seconds, the body above the knees away from the middle of the feet."""
    motion = np.tile(REST, (90, 1, 1))
    middle = motion[0, FEET].mean(axis=0) - motion[0, SBU15.root]
    motion[:, BODY] += np.array([aside, 0, ahead]) + middle * [1, 0, 1]
    return motion - [motion[0, FEET, 0].mean(), 0, motion[0, FEET, 2].mean()]


@pytest.mark.parametrize("ahead", [0.3, -0.2])
def test_a_body_ahead_of_both_feet_moves_back_to_them(ahead: float) -> None:
    given = leaning(ahead)
    found = keep_over_feet(given, given, BOTH, LENGTHS, FPS, SBU15)
    expected = given[:, BODY] - [0, 0, ahead - np.sign(ahead) * MOST]
    np.testing.assert_allclose(found[:, BODY], expected, atol=1e-9)
    np.testing.assert_array_equal(found[:, LEGS], given[:, LEGS])


def test_a_body_that_is_over_the_line_between_its_feet_stays() -> None:
    wide = leaning(0.5 * MOST, 0.2)
    for foot, x in zip(FEET, (0.3, -0.3), strict=True):
        wide[:, foot] = [x, 0.1, 0]
    found = keep_over_feet(wide, wide, BOTH, LENGTHS, FPS, SBU15)
    np.testing.assert_allclose(found, wide, atol=1e-9)


def test_a_body_without_legs_stays() -> None:
    small = np.zeros((90, len(SMALL.joints), 3))
    lengths = np.ones(len(SMALL.bones))
    assert keep_over_feet(small, small, BOTH, lengths, FPS, SMALL) is small


def test_a_body_on_one_foot_may_lean_further() -> None:
    given = leaning(0.3)
    found = keep_over_feet(given, given, LEFT, LENGTHS, FPS, SBU15)
    most = MAX_LEAN_WALKING * leg_length(LENGTHS, SBU15)
    np.testing.assert_allclose(found[:, SBU15.root], given[:, SBU15.root] - [0, 0, 0.3 - most])


def test_a_body_comes_to_where_its_feet_will_stand() -> None:
    given = leaning(0)
    placed = given.copy()
    placed[:, FEET, 2] += 0.2
    found = keep_over_feet(given, placed, BOTH, LENGTHS, FPS, SBU15)
    np.testing.assert_allclose(found[:, BODY], given[:, BODY] + [0, 0, 0.2 - MOST], atol=1e-9)
    np.testing.assert_array_equal(found[:, LEGS], given[:, LEGS])


def test_a_body_that_leans_for_a_moment_comes_back_without_a_jump() -> None:
    given = leaning(0)
    bump = 0.3 * np.exp(-(((np.arange(90) - 45) / 12) ** 2))
    given[:, BODY, 2] += bump[:, None]
    found = keep_over_feet(given, given, BOTH, LENGTHS, FPS, SBU15)[:, SBU15.root, 2]
    before = given[:, SBU15.root, 2]
    middle = before[0]
    assert found.max() - middle < 1.5 * MOST < 0.5 * bump.max()
    speeds = [np.abs(np.diff(path)).max() * FPS for path in (found, before)]
    assert speeds[0] < speeds[1]
    assert found[0] == pytest.approx(before[0], abs=1e-3)
