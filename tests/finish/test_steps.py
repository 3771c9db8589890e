"""Truth: bodies that glide along or turn at known speeds, and one that walks."""

import numpy as np
import pytest

from pacmo_core.data.interaction import bone_lengths
from pacmo_core.data.skeleton import SBU15
from pacmo_core.finish.bones import leg_length, median_lengths, set_legs
from pacmo_core.finish.finish import finish
from pacmo_core.finish.learnt import nothing_learnt
from pacmo_core.finish.stance import frame_runs
from pacmo_core.finish.steps import MAX_STRIDE, STEP_HEIGHT, find_glides, find_lift, take_steps
from pacmo_core.finish.turns import find_collapses, turned
from pacmo_core.formats.registry import open_format
from tests.formats.real_files import real_folder
from tests.reaction.problems import REST
from tests.strategies import SMALL

FPS = 30.0
FEET = SBU15.indices(["left_foot", "right_foot"])
HIPS = SBU15.indices(["left_hip", "right_hip"])
LENGTHS = median_lengths(REST[None].astype(np.float32), SBU15)


def glide(metres: float, turn: float = 0.0, fps: float = FPS) -> np.ndarray:
    """Stand a second, glide ahead and turn in two seconds, stand a second; knees are bent."""
    times = np.arange(round(4 * fps)) / fps
    share = ((times - 1) / 2).clip(0, 1)
    motion = turned(np.tile(crouching(), (len(times), 1, 1)), turn * share)
    motion[..., 2] += metres * share[:, None]
    return motion


def crouching() -> np.ndarray:
    """Bend the knees by 3 cm, and put the left foot ahead."""
    pose = REST.copy()
    pose[[HIPS[0] + 1, HIPS[1] + 1], 2] += 0.1
    pose[:, 1] -= 0.03
    pose[FEET, 1] += 0.03
    pose[FEET[0], 2] += 0.03
    return pose


def walk() -> np.ndarray:
    """Walk ahead at 1.1 m/s; each foot swings for 0.44 s of 1.1 s, half a cycle apart."""
    times = np.arange(120) / FPS
    motion = np.tile(crouching(), (len(times), 1, 1))
    motion[..., 2] += 1.1 * times[:, None]
    for number, foot in enumerate(FEET):
        cycle = times / 1.1 + 0.5 * number
        share = ((cycle % 1) / 0.4).clip(0, 1)
        done = np.floor(cycle) - 0.5 * number + share**2 * (3 - 2 * share)
        motion[:, foot, 2] = 1.21 * done - 0.36
        motion[:, foot, 1] += 0.08 * np.sin(np.pi * share) ** 2
    return motion


def moves(motion: np.ndarray, fps: float = FPS) -> np.ndarray:
    """``(2, T)``: in which frames each foot moves over the floor."""
    speed = np.linalg.norm(np.diff(motion[:, FEET][..., [0, 2]], axis=0), axis=-1) * fps
    return speed.T > 0.1


@pytest.mark.parametrize(("metres", "turn"), [(1.5, 0.0), (0.6, np.pi), (0.8, 1.0)])
def test_a_body_that_glides_takes_steps(metres: float, turn: float) -> None:
    given = glide(metres, turn)
    found = take_steps(given, LENGTHS, FPS, SBU15)
    moving = moves(found)
    assert np.mean(moving.all(axis=0)) < 0.06 < np.mean(moves(given).all(axis=0))
    for number, foot in enumerate(FEET):
        swings = [s for s in frame_runs(moving[number]) if s.stop - s.start > 4]
        lengths = [
            np.linalg.norm((found[s.stop, foot] - found[s.start, foot])[[0, 2]]) for s in swings
        ]
        assert 1 <= len(swings) <= 4
        assert 0.1 < max(lengths) < 1.0
        # A foot that swings is lifted, one that stands is not.
        height = found[:-1, foot, 1] - given[:-1, foot, 1]
        assert all(height[s].max() > 0.06 for s in swings)
        assert np.abs(height[~moving[number]]).max() < 0.05
        assert np.quantile(np.abs(height[~moving[number]]), 0.9) < 0.005
    np.testing.assert_allclose(found[[0, -1]], given[[0, -1]], atol=1e-3)
    reach = found[:, FEET].mean(axis=1) - found[:, HIPS].mean(axis=1)
    assert np.linalg.norm(reach[:, [0, 2]], axis=-1).max() < 0.4


@pytest.mark.parametrize("metres", [0.8, 1.4, 2.0])
def test_strides_are_no_splits(metres: float) -> None:
    in_a_second = glide(metres, fps=FPS / 2)
    found = take_steps(in_a_second, LENGTHS, FPS, SBU15)
    apart = np.linalg.norm((found[:, FEET[0]] - found[:, FEET[1]])[:, [0, 2]], axis=1)
    assert apart.max() < 1.05 * leg_length(LENGTHS, SBU15)


@pytest.mark.parametrize("metres", [0.8, 1.2])
@pytest.mark.parametrize("turn", [-2.6, 2.6])
def test_who_turns_to_walk_away_does_not_lunge(metres: float, turn: float) -> None:
    feet = take_steps(glide(metres, turn), LENGTHS, FPS, SBU15)[:, FEET]
    apart = np.linalg.norm((feet[:, 0] - feet[:, 1])[:, [0, 2]], axis=1)
    assert apart.max() < (MAX_STRIDE + 0.01) * leg_length(LENGTHS, SBU15)


@pytest.mark.parametrize("ahead", [0.25, -0.25])
def test_steps_are_beneath_a_body_whose_feet_were_not(ahead: float) -> None:
    given = glide(2.5)
    given[:, FEET, 2] -= ahead
    found = take_steps(given, LENGTHS, FPS, SBU15)
    middle = slice(round(1.6 * FPS), round(2.4 * FPS))
    before, after = (
        motion[middle][:, FEET, 2].mean() - motion[middle][:, HIPS, 2].mean()
        for motion in (given, found)
    )
    assert before == pytest.approx(-ahead, abs=0.05)
    assert abs(after) < 0.08


def test_a_body_that_lurches_goes_evenly_and_above_the_legs_keeps_its_pose() -> None:
    given = glide(0.0)
    times = np.arange(len(given)) / FPS
    # A metre in 2 s, of which most within a half of a second.
    share = ((times - 1) / 2).clip(0, 1)
    given[..., 2] += (share + 0.4 * (np.tanh(8 * (times - 2)) + 1) / 2)[:, None]
    found = take_steps(given, LENGTHS, FPS, SBU15)
    legs = sorted({*FEET, *(SBU15.parents[foot] for foot in FEET)})
    rest = [j for j in range(15) if j not in legs]
    moved = found[:, rest] - given[:, rest]
    np.testing.assert_allclose(moved, moved[:, :1] * [0, 0, 1] * np.ones((1, 11, 1)), atol=1e-12)
    np.testing.assert_allclose(moved[[0, -1]], 0, atol=1e-12)

    def peak(motion: np.ndarray) -> float:
        # Within the glide: it begins and ends abruptly.
        return float(np.abs(np.diff(motion[36:85, SBU15.root, 2], n=2)).max()) * FPS**2

    assert peak(found) < 0.6 * peak(given)


def test_a_body_that_walks_or_sways_is_hardly_changed() -> None:
    sways = glide(0.1)
    np.testing.assert_allclose(take_steps(sways, LENGTHS, FPS, SBU15), sways, atol=1e-9)
    found = take_steps(walk(), LENGTHS, FPS, SBU15)
    legs = sorted({*FEET, *(SBU15.parents[foot] for foot in FEET)})
    rest = [j for j in range(15) if j not in legs]
    np.testing.assert_array_equal(found[:, rest], walk()[:, rest])
    assert np.linalg.norm(found - walk(), axis=-1)[:, FEET].mean() < 0.01


def test_a_foot_that_is_dragged_is_lifted_and_the_other_stands() -> None:
    given = glide(0.0)
    done = ((np.arange(len(given)) / FPS - 1) / 0.5).clip(0, 1)
    given[:, FEET[0], 2] += 0.4 * (done**2 * (3 - 2 * done))
    assert find_glides(given, FPS, SBU15) == []
    found = take_steps(given, LENGTHS, FPS, SBU15)
    moved = found - given
    assert 0.04 < moved[:, FEET[0], 1].max() <= STEP_HEIGHT
    assert (moved[:, FEET[0], 1] > 0.02).sum() >= 0.3 * FPS
    np.testing.assert_allclose(moved[:20], 0, atol=1e-3)
    np.testing.assert_allclose(moved[60:], 0, atol=1e-3)
    np.testing.assert_allclose(moved[:, FEET[1]], 0, atol=1e-9)
    lifted = given.copy()
    lifted[30:45, FEET[0], 1] += 0.12
    assert find_lift(lifted, FPS, SBU15)[33:42].max() < 0.01


def test_a_glide_up_a_tilted_floor_takes_steps() -> None:
    # 1.5 m by a camera that is tilted by five degrees: 13 cm, more than feet are lifted.
    motion = glide(1.5)
    motion[..., 1] += np.tan(np.radians(5)) * motion[:, :1, 2]
    assert len(find_glides(motion, FPS, SBU15)) == 1
    stepping = take_steps(motion, LENGTHS, FPS, SBU15)
    assert moves(motion).all(axis=0).sum() > 45
    assert moves(stepping).all(axis=0).sum() < 0.2 * moves(motion).all(axis=0).sum()


def test_a_leap_is_no_glide() -> None:
    leap = glide(1.5)
    leap[45:75, :, 1] += 0.4
    found = find_glides(leap, FPS, SBU15)
    assert found
    assert not any(glide.start < 70 and glide.stop > 50 for glide in found)


def test_a_walk_is_hardly_changed_by_the_finish() -> None:
    # The knees of this walk are none of legs of constant length until they are set.
    body = np.tile(crouching(), (120, 1, 1)) + (walk() - crouching())[:, :1]
    set_legs(body, walk(), np.full(body.shape[:2], -np.inf), LENGTHS, SBU15)
    given = body.astype(np.float32)
    partner = np.tile(crouching() + np.array([0, 0, 6.0]), (len(given), 1, 1)).astype(np.float32)
    times = np.arange(len(given)) / FPS
    found = finish(given, partner, times, SBU15, nothing_learnt(SBU15))
    moved = np.linalg.norm(found - given, axis=-1)
    assert moved.mean() < 0.02


def test_bones_are_exact_after_steps_and_the_finish_keeps_feet_where_they_stand() -> None:
    given = glide(1.5).astype(np.float32)
    partner = np.tile(crouching() + np.array([0, 0, 4.0]), (len(given), 1, 1)).astype(np.float32)
    found = finish(given, partner, np.arange(len(given)) / FPS, SBU15, nothing_learnt(SBU15))
    expected = np.tile(median_lengths(given, SBU15), (len(given), 1))
    np.testing.assert_allclose(bone_lengths(found, SBU15), expected, rtol=1e-6, atol=3e-7)
    speed = np.linalg.norm(np.diff(found[:, FEET][..., [0, 2]], axis=0), axis=-1) * FPS
    assert np.mean(speed.min(axis=1) > 0.1) < 0.1


@pytest.mark.parametrize("yaw", [-2.5, 0.4, 2.0])
def test_stepping_commutes_with_turning(yaw: float) -> None:
    given = glide(1.2, 1.5)
    whole = np.full(len(given), yaw)
    expected = turned(take_steps(given, LENGTHS, FPS, SBU15), whole)
    found = take_steps(turned(given, whole), LENGTHS, FPS, SBU15)
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_steps_hardly_depend_on_the_frame_rate() -> None:
    slow, fast = (take_steps(glide(1.5, fps=f), LENGTHS, f, SBU15) for f in (30.0, 120.0))
    assert np.linalg.norm(fast[::4] - slow, axis=-1).mean() < 0.005


def test_glides_are_those_of_both_feet_over_the_floor() -> None:
    assert len(find_glides(glide(1.5), FPS, SBU15)) == 1
    one = glide(1.5)
    one[:, FEET[0]] = one[:1, FEET[0]]
    assert find_glides(one, FPS, SBU15) == []
    assert find_glides(np.zeros((5, len(SMALL.joints), 3)), FPS, SMALL) == []


def test_captured_dancers_and_greeters_do_not_collapse_and_hardly_glide() -> None:
    plain = {"unit": None, "up": None, "fps": None, "max_root_distance": None}
    settings = {**plain, "preset": "duo_mocap", "end_sites": False, "skip_frames": 0}
    reader, shares = open_format("bvh", settings), []
    for sequence in reader.find(real_folder("duo_mocap")):
        if "salsa/" not in sequence.name and "greeting" not in sequence.name:
            continue
        clip = reader.read(sequence).interaction
        fps = float(1 / np.median(np.diff(clip.times)))
        for person in (clip.person_a, clip.person_b):
            motion = person.astype(np.float64)
            assert find_collapses(motion, fps, clip.skeleton) == []
            glides = find_glides(motion, fps, clip.skeleton)
            shares.append(sum(glide.stop - glide.start for glide in glides) / len(motion))
    # A dancer who spins on the balls of both feet glides.
    assert len(shares) >= 6
    assert np.mean(shares) < 0.01


def test_a_body_of_few_frames_a_second_is_taken() -> None:
    for seed in range(100):
        random = np.random.default_rng(seed)
        n_frames, fps = int(random.integers(2, 9)), float(random.uniform(0.5, 10))
        given = np.repeat(glide(0.0, 0.0)[:1], n_frames, axis=0)
        given[..., [0, 2]] += random.uniform(-0.6, 0.6, (n_frames, 1, 2)).cumsum(axis=0)
        found = take_steps(given, LENGTHS, fps, SBU15)
        assert found.shape == given.shape and np.isfinite(found).all()


@pytest.mark.parametrize("aside", [-1.2, 1.2])
@pytest.mark.parametrize("turn", [0.0, -2.5])
def test_feet_of_a_body_that_goes_aside_do_not_cross(aside: float, turn: float) -> None:
    given = glide(0.0, turn)
    share = ((np.arange(len(given)) / FPS - 1) / 2).clip(0, 1)
    given[..., 0] += aside * share[:, None]
    found = take_steps(given, LENGTHS, FPS, SBU15)
    assert np.mean(moves(found).all(axis=0)) < 0.1 < np.mean(moves(given).all(axis=0))
    left = found[:, HIPS[0]] - found[:, HIPS[1]]
    left /= np.linalg.norm(left, axis=-1, keepdims=True)
    apart = ((found[:, FEET[0]] - found[:, FEET[1]]) * left).sum(axis=-1)
    assert apart.min() > 0.03
    assert apart.max() < 0.6
