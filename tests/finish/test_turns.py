"""Truth: the mean of a turn to the left and one to the right, and bodies that turn as a whole."""

import numpy as np
import pytest

from pacmo_core.data.skeleton import SBU15
from pacmo_core.finish.finish import finish
from pacmo_core.finish.learnt import nothing_learnt
from pacmo_core.finish.turns import TURN_SPEED, find_headings, resolve_turns, turned
from tests.reaction.problems import REST
from tests.strategies import SMALL

FPS = 30.0


def angles(turn: float, seconds: float = 1.0) -> np.ndarray:
    """Stand for a second and a half, turn, and stand for a second and a half."""
    times = np.arange(round((3 + seconds) * FPS)) / FPS
    return turn * ((times - 1.5) / seconds).clip(0, 1)


def body(headings: np.ndarray) -> np.ndarray:
    return turned(np.tile(REST, (len(headings), 1, 1)), headings)


def averaged(turn: float) -> np.ndarray:
    """Return the mean of three turns to the left and two to the right; it has come to stand."""
    left, right = body(angles(turn)), body(angles(turn - 2 * np.pi))
    return 0.6 * left + 0.4 * right


def distances(motion: np.ndarray) -> np.ndarray:
    return np.linalg.norm(motion[:, :, None] - motion[:, None], axis=-1)


@pytest.mark.parametrize("turn", [np.pi - 0.2, np.pi + 0.2, 2.8])
def test_a_body_that_collapses_is_turned_about_as_a_whole(turn: float) -> None:
    given = averaged(turn)
    shape = distances(REST[None])
    assert (distances(given) < 0.6 * shape).any()
    found = resolve_turns(given, FPS, SBU15)
    assert (distances(found) >= 0.7 * shape).all()
    np.testing.assert_allclose(found[[0, -1]], given[[0, -1]], atol=1e-6)
    speed = np.abs(np.gradient(find_headings(found, FPS, SBU15), 1 / FPS))
    # At its ends the turn joins what is left of those that were averaged.
    assert np.abs(np.gradient(find_headings(given, FPS, SBU15), 1 / FPS)).max() > 5
    assert speed.max() < 1.2 * TURN_SPEED


def test_it_turns_the_shorter_way_round() -> None:
    for turn in (2.8, 2 * np.pi - 2.8):
        headings = find_headings(resolve_turns(averaged(turn), FPS, SBU15), FPS, SBU15)
        expected = turn if turn < np.pi else turn - 2 * np.pi
        assert headings[-1] - headings[0] == pytest.approx(expected, abs=0.01)


@pytest.mark.parametrize("turn", [0.5, np.pi, -2 * np.pi])
def test_a_body_that_turns_as_a_whole_is_unchanged(turn: float) -> None:
    given = body(angles(turn, 1.5))
    np.testing.assert_array_equal(resolve_turns(given, FPS, SBU15), given)


def test_a_body_that_lies_down_on_its_side_is_unchanged() -> None:
    fall = angles(np.pi / 2)
    given = np.tile(REST, (len(fall), 1, 1))
    x, y = given[..., 0].copy(), given[..., 1].copy()
    given[..., 0] = np.cos(fall)[:, None] * x - np.sin(fall)[:, None] * y
    given[..., 1] = np.sin(fall)[:, None] * x + np.cos(fall)[:, None] * y
    np.testing.assert_array_equal(resolve_turns(given, FPS, SBU15), given)


def test_a_collapse_at_an_end_keeps_the_heading_beside_it() -> None:
    for cut in (slice(61, None), slice(0, 59)):
        given = averaged(np.pi - 0.2)[cut]
        found = resolve_turns(given, FPS, SBU15)
        assert np.ptp(find_headings(found, FPS, SBU15)) < 0.6
        assert (distances(found) >= 0.7 * distances(REST[None])).all()


@pytest.mark.parametrize("yaw", [-2.5, 0.4, 2.0])
def test_resolving_and_finishing_commute_with_turning_both(yaw: float) -> None:
    given = averaged(np.pi - 0.2)
    partner = np.tile(REST + np.array([0, 0, 1.5]), (len(given), 1, 1))
    whole = np.full(len(given), yaw)
    there = turned(resolve_turns(given, FPS, SBU15), whole)
    np.testing.assert_allclose(resolve_turns(turned(given, whole), FPS, SBU15), there, atol=1e-6)
    times = np.arange(len(given)) / FPS
    # One foot is ahead, so that no choice hangs on round-off.
    given[:, SBU15.joints.index("left_foot")] += 0.05 * (given[:, 3] - given[:, 6])
    finished, after = (
        finish(turn(given), turn(partner), times, SBU15, nothing_learnt(SBU15))
        for turn in (lambda motion: motion, lambda motion: turned(motion, whole))
    )
    np.testing.assert_allclose(after, turned(finished, whole), atol=1e-3)


def test_a_skeleton_without_limbs_is_unchanged() -> None:
    given = np.random.default_rng(0).standard_normal((20, len(SMALL.joints), 3))
    np.testing.assert_array_equal(resolve_turns(given, FPS, SMALL), given)
