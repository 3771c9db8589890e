"""Truth: bodies of known size that stand on a known plane."""

from dataclasses import replace

import numpy as np
import pytest

from pacmo_core.data.skeleton import NTU25
from pacmo_core.finish.bones import leg_length, median_lengths, set_legs
from pacmo_core.finish.finish import finish
from pacmo_core.finish.floor import (
    ANKLE_SHARE,
    FLOOR_TOLERANCE,
    MIN_FLOORS,
    ONE_FLOOR,
    find_floor,
    floor_errors,
    learn_floor_tolerance,
    set_down,
)
from pacmo_core.finish.learnt import nothing_learnt
from tests.strategies import make_interaction

FOOT = NTU25.indices(["left_ankle", "left_foot"])
ANKLES = NTU25.indices(["left_ankle", "right_ankle"])
LEG = 0.8


def standing(
    leg: float, place: tuple[float, float] = (0.0, 0.0), slope: tuple[float, float] = (0.0, 0.0)
) -> np.ndarray:
    """Return a body in proportion to its legs, whose ankles are over the plane by their share."""
    pose = np.zeros((len(NTU25.joints), 3))
    pose[:, 1] = 1.6
    for side, x in (("left", 0.1), ("right", -0.1)):
        hip, knee, ankle, foot = NTU25.indices(
            [f"{side}_{name}" for name in ("hip", "knee", "ankle", "foot")]
        )
        pose[[hip, knee, ankle], 1] = np.array([1, 0.5, 0]) + ANKLE_SHARE
        pose[foot] = [0, 0.02, 0.12]
        pose[[hip, knee, ankle, foot], 0] = x / leg
    pose = leg * pose + [place[0], 0, place[1]]
    pose[:, 1] += pose[:, 0] * slope[0] + pose[:, 2] * slope[1]
    return np.tile(pose, (20, 1, 1)).astype(np.float32)


def found(motion: np.ndarray):
    return find_floor(motion, np.ones((2, len(motion)), dtype=bool), NTU25)


@pytest.mark.parametrize("child", [0.4, 0.6])
def test_the_feet_of_a_child_rest_lower_than_those_of_an_adult(child):
    adult = median_lengths(standing(LEG), NTU25)
    assert leg_length(adult, NTU25) == pytest.approx(LEG, abs=1e-5)
    floor, own = found(standing(LEG)), standing(child)
    expected = own[0, FOOT, 1]
    np.testing.assert_allclose(floor.height + floor.of(child), expected, atol=1e-5)
    assert expected[0] < standing(LEG)[0, FOOT[0], 1] - 0.01


def test_the_plane_of_a_tilted_camera_is_that_under_somebody_who_walks_about():
    slope = (0.02, -0.03)
    places = [(0.0, 0.0), (1.0, 0.2), (0.3, 1.0), (1.2, 1.4)]
    motion = np.concatenate([standing(LEG, place, slope) for place in places])
    stance = np.zeros((2, len(motion)), dtype=bool)
    stance[0, np.arange(len(motion)) // 20 % 2 == 0] = True
    stance[1] = ~stance[0]
    floor = find_floor(motion, stance, NTU25)
    there = standing(LEG, (2.0, 1.0), slope)[0, ANKLES]
    before = floor.height - there[:, 1].mean()
    error = floor.at(there.astype(np.float64)) + floor.rest[0] - there[:, 1]
    assert np.abs(error).max() < 0.25 * abs(before)


def test_somebody_who_stays_in_one_place_is_on_a_level_floor():
    floor = found(standing(LEG, (1.0, 2.0)))
    assert np.abs(floor.slope).max() < 1e-6
    assert floor.height == pytest.approx(0, abs=1e-6)


def test_a_foot_that_is_held_up_throughout_says_nothing_of_the_floor():
    motion = standing(LEG)
    motion[:, NTU25.indices(["right_ankle", "right_foot"]), 1] += np.float32(0.6)
    floor = found(motion)
    assert np.abs(floor.slope).max() < 1e-6
    assert floor.height == pytest.approx(0, abs=0.01)


def test_feet_that_never_stand_are_on_the_floor_where_they_are_lowest():
    motion = standing(LEG)
    motion[:, :, 1] += np.abs(np.linspace(-1, 1, len(motion)))[:, None].astype(np.float32)
    floor = find_floor(motion, np.zeros((2, len(motion)), dtype=bool), NTU25)
    assert floor.height == pytest.approx(0.053, abs=0.01)


@pytest.mark.parametrize(
    ("low", "tolerance", "rise"),
    [
        (0.1, ONE_FLOOR, 0.1),
        (-0.15, ONE_FLOOR, -0.15),
        (0.6, ONE_FLOOR, 0.6),
        (0.1, FLOOR_TOLERANCE, 0.1),
        (0.6, FLOOR_TOLERANCE, 0.0),  # beyond a chair's height the two stand on floors of their own
    ],
)
def test_a_body_that_is_too_low_as_a_whole_rises_as_a_whole(
    low: float, tolerance: float, rise: float
) -> None:
    partner, given = standing(LEG), standing(LEG, (0.0, 2.0))
    given[..., 1] -= low
    times = np.arange(len(given)) / 30.0
    learnt = replace(nothing_learnt(NTU25), floor_tolerance=np.array(tolerance))
    there = finish(given, partner, times, NTU25, learnt)
    np.testing.assert_allclose(there[..., 1], given[..., 1] + rise, atol=2e-3)


def test_a_body_that_sinks_for_seconds_rises_for_these_alone():
    partner = np.tile(standing(LEG, (0.0, 2.0))[:1], (300, 1, 1))
    given = np.tile(standing(LEG)[:1], (300, 1, 1))
    times = np.arange(300) / 30.0
    sunk = 0.4 * np.clip(3 - np.abs(times - 5), 0, 1)  # as deep from 3 to 7 s
    given[..., 1] -= sunk[:, None].astype(np.float32)
    nobody_aloft = np.zeros(300, bool)
    found = set_down(given.astype(np.float64), partner, 30.0, NTU25, ONE_FLOOR, nobody_aloft)
    settled = (np.abs(times - 2.5) > 1.5) & (np.abs(times - 7.5) > 1.5)
    wanted = np.broadcast_to(partner[0, :, 1], found[..., 1].shape)
    np.testing.assert_allclose(found[settled][..., 1], wanted[settled], atol=0.02)
    np.testing.assert_allclose(found[..., 1], wanted, atol=0.2)


def test_where_captures_place_each_persons_floor_by_itself_people_stand_on_their_own():
    partner, captured, given = standing(LEG), standing(LEG, (0.0, 2.0)), standing(LEG, (0.0, 2.0))
    given[..., 1] += 0.03
    shared = floor_errors(given, captured, partner, 30.0, NTU25)
    lower = (partner - np.float32([0, 0.2, 0])).astype(np.float32)
    apart = floor_errors(given, captured, lower, 30.0, NTU25)
    np.testing.assert_allclose([shared, apart], [[0.03, 0], [0.03, -0.2]], atol=1e-4)
    assert learn_floor_tolerance(np.tile(shared, (MIN_FLOORS, 1))) == ONE_FLOOR
    assert learn_floor_tolerance(np.tile(apart, (MIN_FLOORS, 1))) == 0
    assert learn_floor_tolerance(np.tile(apart, (MIN_FLOORS - 1, 1))) == ONE_FLOOR
    times = np.arange(len(given)) / 30.0
    for tolerance, height in ((FLOOR_TOLERANCE, -0.2), (0.0, 0.03)):
        learnt = replace(nothing_learnt(NTU25), floor_tolerance=np.array(tolerance))
        there = finish(given, lower, times, NTU25, learnt)
        np.testing.assert_allclose(there[..., 1], captured[..., 1] + height, atol=2e-3)


def test_where_some_captured_people_stand_on_a_chair_a_body_may_stay_on_one():
    on_one, on_chair = [0.03, 0.0], [0.03, 0.45]
    assert learn_floor_tolerance(np.array([on_one] * 19 + [on_chair])) == FLOOR_TOLERANCE
    # One capture of a hundred may be wrong.
    assert learn_floor_tolerance(np.array([on_one] * 99 + [on_chair])) == ONE_FLOOR


def raised_feet(left: float, right: float, seconds: float = 0.6) -> np.ndarray:
    """Stand for a second, raise both feet by ``(left, right)`` metres under a body that stays."""
    times = np.arange(78) / 30.0
    motion = np.repeat(standing(LEG)[:1].astype(np.float64), len(times), axis=0)
    wanted, share = motion.copy(), np.sin(np.pi * ((times - 1) / seconds).clip(0, 1)) ** 2
    for ankle, rise in zip(ANKLES, (left, right), strict=True):
        wanted[:, [ankle, ankle + 1], 1] += rise * share[:, None]
        wanted[:, [ankle, ankle + 1], 2] += rise * share[:, None]
    lengths = median_lengths(standing(LEG), NTU25)
    set_legs(motion, wanted, np.full(motion.shape[:2], -np.inf), lengths, NTU25)
    return motion


def test_the_lower_of_two_feet_in_the_air_is_set_down_and_the_other_stays() -> None:
    given, partner = raised_feet(0.3, 0.6), np.tile(standing(LEG, (0.0, 2.0))[:1], (78, 1, 1))
    found = set_down(given, partner, 30.0, NTU25, ONE_FLOOR, np.zeros(78, bool))
    peak = int(given[:, ANKLES[1], 1].argmax())
    ground = given[0, ANKLES, 1]
    assert (given[peak, ANKLES, 1] - ground > 0.29).all()
    assert found[peak, ANKLES[0], 1] - ground[0] < 0.06
    above = [joint for joint in range(len(NTU25.joints)) if joint not in FOOT]
    np.testing.assert_allclose(found[:, above], given[:, above], atol=6e-3)
    kicks = finish(
        given.astype(np.float32), partner, np.arange(78) / 30.0, NTU25, nothing_learnt(NTU25)
    )
    assert kicks[peak, ANKLES[1], 1] - ground[1] > 0.5


def test_a_skeleton_of_random_bones_has_finite_numbers():
    clip = make_interaction(np.random.default_rng(0))
    motion = np.resize(clip.person_a, (12, len(NTU25.joints), 3))
    floor = find_floor(motion, np.zeros((2, 12), dtype=bool), NTU25)
    assert np.isfinite([floor.height, *floor.slope, *floor.rest]).all()


def pitches(motion: np.ndarray) -> np.ndarray:
    """Return the degrees by which the left foot points down."""
    ankle, toe = (motion[:, joint] for joint in FOOT)
    return np.degrees(
        np.arctan2(ankle[:, 1] - toe[:, 1], np.linalg.norm((toe - ankle)[:, ::2], axis=-1))
    )


@pytest.mark.parametrize("toe", [-0.05, 0.05])
def test_feet_keep_their_shape_and_their_lowest_joint_rests_as_low_as_the_partners(toe):
    person, partner = standing(LEG), standing(LEG, (0.0, 2.0))
    toes = NTU25.indices(["left_foot", "right_foot"])
    partner[:, toes, 1] = LEG * toe
    finished = finish(person, partner, np.arange(20) / 30.0, NTU25, nothing_learnt(NTU25))
    np.testing.assert_allclose(pitches(finished), pitches(person), atol=1)
    lowest = finished[:, FOOT, 1].min(axis=1)
    np.testing.assert_allclose(lowest, partner[0, FOOT, 1].min(), atol=4e-3)


def test_two_feet_that_a_sensor_places_at_different_heights_do_not_tilt_the_floor():
    motion = standing(LEG, (1.0, 2.0))
    motion[:, NTU25.indices(["right_ankle", "right_foot"]), 1] += np.float32(0.05)
    in_turn = np.arange(len(motion)) % 2 == np.arange(2)[:, None]  # as if in a place of its own
    there = np.array([2.5, 0.0, 2.0])  # a partner's place
    floor = find_floor(motion, in_turn, NTU25)
    assert floor.at(there) == pytest.approx(0.025, abs=0.02)
