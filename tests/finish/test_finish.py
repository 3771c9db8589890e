"""Truth: bodies of known bones, feet that stand at known places, hands at known distances."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pacmo_core.data.interaction import bone_lengths
from pacmo_core.data.skeleton import SBU15
from pacmo_core.data.transforms import Frame
from pacmo_core.finish import finish as finish_module
from pacmo_core.finish.body import TargetBody, is_plausible
from pacmo_core.finish.contacts import end_effector_groups, no_contacts
from pacmo_core.finish.finish import FrameFinish, finish
from pacmo_core.finish.learnt import nothing_learnt
from tests.reaction.problems import REST, delayed_mirror
from tests.strategies import make_interaction

HAND, FOOT = SBU15.joints.index("left_hand"), SBU15.joints.index("left_foot")
LIMB = SBU15.indices(["left_shoulder", "left_elbow", "left_hand"])
FEET = SBU15.indices(["left_foot", "right_foot"])
NONE = nothing_learnt(SBU15)


def closing_hands() -> np.ndarray:
    """Return a model of contacts that closes hands within 25 cm of each other to 4 cm."""
    groups = end_effector_groups(SBU15)
    hands, model = groups[SBU15.end_effectors.index(HAND)], no_contacts(SBU15)
    model[hands * (groups.max() + 1) + hands] = [10, -40, 0, 0.04]
    return model


CLOSING = replace(nothing_learnt(SBU15), contacts=closing_hands())


def standing(n_frames: int = 60, fps: float = 30.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Let two bodies stand face to face, 0.9 m apart; the reaction reaches out with a hand.

    The reaction's left hand comes within 15 cm of the partner's right hand, bones constant.
    """
    times = np.arange(n_frames) / fps
    partner = np.tile(REST, (n_frames, 1, 1))
    reaction = np.tile(REST * [-1, 1, -1] + [0, 0, 0.9], (n_frames, 1, 1))
    raised = np.sin(np.pi * times / times[-1])[:, None] ** 2
    for body, side, forward in ((partner, "right", 0.3), (reaction, "left", -0.3)):
        shoulder, elbow, hand = SBU15.indices(
            [f"{side}_{j}" for j in ("shoulder", "elbow", "hand")]
        )
        upper, lower = (
            np.linalg.norm(REST[b] - REST[a]) for a, b in ((shoulder, elbow), (elbow, hand))
        )
        ahead, down = np.array([0, 0, np.sign(forward)]), np.array([0, -1.0, 0])
        angle = np.pi / 2 * raised
        along = np.cos(angle) * down + np.sin(angle) * ahead
        body[:, elbow] = body[:, shoulder] + upper * along
        body[:, hand] = body[:, elbow] + lower * along
    return partner.astype(np.float32), reaction.astype(np.float32), times


def gap(partner: np.ndarray, reaction: np.ndarray) -> np.ndarray:
    return np.linalg.norm(partner[:, :, None] - reaction[:, None], axis=-1).min(axis=(1, 2))


@settings(derandomize=True, deadline=None, max_examples=10)
@given(st.integers(0, 2**31), st.integers(1, 40))
def test_bones_keep_their_median_lengths_whatever_the_motion(seed, n_frames):
    random = np.random.default_rng(seed)
    reaction, partner = (
        (REST + 0.1 * random.standard_normal((n_frames, 15, 3))).astype(np.float32)
        for _ in range(2)
    )
    times = np.arange(n_frames) / 30
    found = bone_lengths(finish(reaction, partner, times, SBU15, NONE), SBU15)
    own, partners = (np.median(bone_lengths(m, SBU15), axis=0) for m in (reaction, partner))
    expected = own if is_plausible(own, partners, SBU15) else partners
    # Positions of float32 a metre away are rounded by 1e-7 m.
    np.testing.assert_allclose(found, np.tile(expected, (n_frames, 1)), rtol=1e-6, atol=3e-7)


@pytest.mark.parametrize(("size", "is_kept"), [(0.7, False), (0.9, True), (1.2, True), (9, False)])
def test_a_giant_or_a_dwarf_gets_the_partners_body(size, is_kept):
    partner, reaction, times = standing()
    found = finish((size * reaction).astype(np.float32), partner, times, SBU15, NONE)
    own = np.median(bone_lengths(reaction, SBU15), axis=0)
    lengths = np.median(bone_lengths(found, SBU15), axis=0)
    np.testing.assert_allclose(lengths, own * (size if is_kept else 1), rtol=1e-3)
    heights = found[:, FEET, 1]
    assert np.abs(heights - partner[:, FEET, 1].mean()).max() < 0.03


@pytest.mark.parametrize("size", [0.85, 0.95, 1.15])
def test_a_body_of_given_bones_meets_the_hand_that_the_generated_one_meets(size):
    partner, reaction, times = standing()
    lengths = size * np.median(bone_lengths(reaction, SBU15), axis=0)
    before = gap(partner, reaction)
    after = finish(reaction, partner, times, SBU15, CLOSING, TargetBody(lengths))
    found = bone_lengths(after, SBU15)
    np.testing.assert_allclose(found, np.tile(lengths, (len(times), 1)), atol=1e-6)
    nearest = before.argmin()
    assert gap(partner, after)[nearest] == pytest.approx(0.04, abs=0.06)
    np.testing.assert_allclose(
        after[:, FEET][..., [0, 2]], reaction[:, FEET][..., [0, 2]], atol=0.03
    )
    assert np.ptp(after[:, FEET], axis=0).max() < 0.01  # they stand


def test_a_motion_that_needs_no_finish_hardly_moves():
    partner, reaction, times = standing()
    assert np.abs(finish(reaction, partner, times, SBU15, NONE) - reaction).max() < 1e-3


def test_a_finished_motion_hardly_moves_when_it_is_finished_again():
    clip = delayed_mirror(3, np.arange(60) / 30)
    arguments = (clip.person_a, clip.times, SBU15, NONE)
    once = finish(clip.person_b, *arguments)
    twice = finish(once, *arguments)
    first, second = (
        np.linalg.norm(step, axis=-1).mean() for step in (once - clip.person_b, twice - once)
    )
    assert second < 0.25 * first


def test_a_predicted_contact_is_closed_to_the_mapped_distance():
    partner, reaction, times = standing()
    reaction[:, :, 2] += 0.15
    before = gap(partner, reaction)
    nearest = before.argmin()
    assert 0.1 < before[nearest] < 0.2
    after = gap(partner, finish(reaction, partner, times, SBU15, CLOSING))
    assert after[nearest] == pytest.approx(0.04, abs=0.02)


def test_no_contact_is_made_where_none_is_predicted():
    partner, reaction, times = standing()
    reaction[:, :, 2] += 0.6
    before = gap(partner, reaction)
    assert before.min() > 0.45
    after = gap(partner, finish(reaction, partner, times, SBU15, CLOSING))
    np.testing.assert_allclose(after, before, atol=2e-3)


def test_the_partner_is_not_touched_and_neither_is_the_reaction_given():
    partner, reaction, times = standing()
    given = partner.copy(), reaction.copy()
    finish(reaction, partner, times, SBU15, CLOSING)
    np.testing.assert_array_equal(partner, given[0])
    np.testing.assert_array_equal(reaction, given[1])


def test_a_foot_that_glides_is_planted():
    partner, reaction, times = standing()
    reaction[:, :, 0] += 0.03 * np.sin(2 * np.pi * times / times[-1])[:, None].astype(np.float32)
    found = finish(reaction, partner, times, SBU15, NONE)
    before, after = (np.ptp(motion[:, FEET, 0], axis=0).max() for motion in (reaction, found))
    assert before > 0.059
    assert after < 0.01


def test_feet_are_not_below_the_floor_on_which_the_partner_stands():
    partner, reaction, times = standing()
    reaction[:, :, 1] -= 0.05 * np.sin(np.pi * times / times[-1])[:, None].astype(np.float32) ** 2
    found = finish(reaction, partner, times, SBU15, NONE)
    assert found[:, FEET, 1].min() > partner[:, FEET, 1].min() - 0.005


@settings(derandomize=True, deadline=None, max_examples=8)
@given(st.floats(-3, 3), st.floats(-2, 2), st.floats(-2, 2))
def test_finishing_commutes_with_turning_and_moving_both(yaw, x, z):
    clip = delayed_mirror(4, np.arange(40) / 30)
    # One foot moves less, and one hand is nearer, than the other: no choice hangs on round-off.
    clip.person_b[:, FOOT] = (
        clip.person_b[:1, FOOT] + 0.5 * (clip.person_b - clip.person_b[:1])[:, FOOT]
    )
    frame = Frame(np.array([x, 0.3, z]), yaw)
    here = finish(clip.person_b, clip.person_a, clip.times, SBU15, CLOSING)
    moved = [frame.to_world(motion) for motion in (clip.person_b, clip.person_a)]
    there = finish(*moved, clip.times, SBU15, CLOSING)
    np.testing.assert_allclose(there, frame.to_world(here), atol=1e-3)


def test_the_result_hardly_depends_on_the_frame_rate():
    fast, slow = (standing(n, fps)[:2] for n, fps in ((121, 60.0), (61, 30.0)))
    found = []
    for (partner, reaction), fps in ((fast, 60.0), (slow, 30.0)):
        reaction[:, :, 2] += 0.15
        found.append(finish(reaction, partner, np.arange(len(reaction)) / fps, SBU15, CLOSING))
    difference = np.linalg.norm(found[0][::2] - found[1], axis=-1)
    assert difference.mean() < 0.002
    assert difference.max() < 0.02


def test_a_long_motion_in_parts_is_that_in_one_solve(monkeypatch):
    clip = delayed_mirror(6, np.arange(300) / 30)
    arguments = (clip.person_b, clip.person_a, clip.times, SBU15, CLOSING)
    whole = finish(*arguments)
    monkeypatch.setattr(finish_module, "PART_FRAMES", 120)
    monkeypatch.setattr(finish_module, "OVERLAP_FRAMES", 40)
    np.testing.assert_allclose(finish(*arguments), whole, atol=2e-3)


def test_a_skeleton_without_named_limbs_is_finished_too():
    clip = make_interaction(np.random.default_rng(0))
    learnt = nothing_learnt(clip.skeleton)
    found = finish(clip.person_b, clip.person_a, clip.times, clip.skeleton, learnt)
    lengths = bone_lengths(found, clip.skeleton)
    np.testing.assert_allclose(lengths, lengths[:1].repeat(len(lengths), axis=0), rtol=1e-5)


def test_a_frame_is_finished_with_the_lengths_of_the_first_and_above_the_floor():
    partner, reaction, _ = standing()
    live = FrameFinish(reaction[None, :10], partner[0], SBU15, NONE)
    pose = reaction[30].copy()
    pose[HAND] += 0.1
    pose[:, 1] -= 0.07
    found = live(pose[None])[0]
    expected = bone_lengths(reaction[:1], SBU15)
    np.testing.assert_allclose(bone_lengths(found[None], SBU15), expected, rtol=1e-5)
    assert found[FEET, 1].min() >= partner[0, FEET, 1].min() - 1e-6


def test_feet_that_glide_far_step_in_turn_beneath_the_body():
    partner, reaction, times = standing(120)
    reaction[:, :, 0] += 2.0 * (times / times[-1])[:, None].astype(np.float32)
    found = finish(reaction, partner, times, SBU15, NONE)
    hips = found[:, SBU15.indices(["left_hip", "right_hip"]), 0].mean(axis=1)
    assert np.abs(found[:, FEET, 0].mean(axis=1) - hips).max() < 0.35
    speed = np.abs(np.gradient(found[:, FEET, 0], times, axis=0))
    # The body moves at half a metre a second: mostly one foot rests.
    assert np.mean(speed.min(axis=1) < 0.1) > 0.6


def test_a_body_that_floats_along_is_set_on_the_floor():
    partner, reaction, times = standing()
    reaction[:, :, 0] += 4.0 * times[:, None].astype(np.float32)  # too fast for feet that stand
    for height in (0.1, 0.5):
        floating = (reaction + np.float32([0, height, 0])).astype(np.float32)
        found = finish(floating, partner, times, SBU15, NONE)
        above = found[:, FEET, 1].min(axis=1) - partner[0, FEET, 1].min()
        assert np.abs(above).max() < 0.02


@pytest.mark.parametrize("height", [0.2, 0.5])
def test_a_jump_stays_where_captured_bodies_jump_and_is_none_elsewhere(height: float) -> None:
    partner, reaction, times = standing(90)
    flight = np.linspace(0, 1, 20)
    reaction[30:50, :, 1] += (height * 4 * flight * (1 - flight))[:, None].astype(np.float32)
    ground = partner[0, FEET, 1].min()
    jumping = replace(nothing_learnt(SBU15), leaves_floor=np.array(1.0))
    found = [finish(reaction, partner, times, SBU15, learnt) for learnt in (jumping, NONE)]
    above, grounded = (motion[:, FEET, 1].min(axis=1) - ground for motion in found)
    np.testing.assert_allclose(above[40], reaction[40, FEET, 1].min() - ground, atol=0.02)
    assert np.abs(above[[*range(25), *range(55, 90)]]).max() < 0.02
    assert grounded.max() < 0.06


def test_the_mean_of_two_kicks_becomes_a_kick():
    """Both feet are raised ahead by halves: one carries the body, the other kicks on."""
    partner, reaction, times = standing(90)
    raised = np.zeros(90)
    raised[30:60] = np.sin(np.linspace(0, np.pi, 30))
    for foot, height in zip(FEET, (0.5, 0.35), strict=True):
        reaction[:, foot, 1] += (height * raised).astype(np.float32)
        reaction[:, foot, 2] -= (0.6 * raised).astype(np.float32)
    found = finish(reaction, partner, times, SBU15, NONE)
    above = found[:, FEET, 1] - partner[0, FEET, 1].min()
    assert np.abs(above.min(axis=1)).max() < 0.05
    assert above[45, 0] > 0.3
    # It stands where it stood, below the body.
    assert np.ptp(found[:, FEET[1]][:, [0, 2]], axis=0).max() < 0.05
