"""Invariants of the finish: bones, stances, the floor, touches, turns about the vertical."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch.nn.functional import normalize

from pacmo_core.skeleton_prior.finish import (
    MAX_BEND_SPEED,
    Finish,
    _Bodies,
    bend_height,
    bent_length,
    slowed,
    soften,
    turned,
)
from pacmo_core.skeleton_prior.inference import find_supports
from pacmo_core.skeleton_prior.kinematics import find_limbs
from tests.skeleton_prior.examples import SMALL, generator, interaction, scale_bones

SIDES = ("left", "right")
ANKLES = [SMALL.joints.index(f"{side}_ankle") for side in SIDES]
N_FRAMES = 31


def standing(seed: int = 0):
    """Two people who swing above ankles that stand on the floor in all frames but the last ten."""
    source = interaction(seed, n_frames=N_FRAMES)
    for person in (source.person_a, source.person_b):
        person[:21, ANKLES] = person[0, ANKLES]
        person[:21, ANKLES, 1] = person[..., 1].min() - 0.01
        person[21:, ANKLES] += person[20, ANKLES] - person[21, ANKLES]
        person[21:, ANKLES, 1] = person[20, ANKLES, 1] + 0.05
    return source


def finish_of(source):
    both = torch.from_numpy(np.stack([source.person_a, source.person_b], axis=1))
    limbs = find_limbs(SMALL, source.person_a)
    return Finish(SMALL, limbs, both, find_supports(source), source.fps)


def disturbed(finish, scales, seed=0, size=0.03):
    """Scaled postures of the source, and some centimetres of noise that changes slowly."""
    random = generator(seed)
    people = [
        scale_bones(
            finish.source[:, k].double().numpy(), SMALL, scales[k, SMALL.bones[:, 1]].numpy()
        )
        for k in (0, 1)
    ]
    motion = torch.from_numpy(np.stack(people, axis=1)).float()
    phase = 6 * torch.rand(1, 2, len(SMALL.joints), 3, generator=random)
    times = torch.linspace(0, 4, N_FRAMES)[:, None, None, None]
    return (motion + size * torch.sin(times + phase))[None]


def uniform(a, b):
    scales = torch.ones(2, len(SMALL.joints))
    scales[0], scales[1] = a, b
    return scales


def test_the_source_on_its_own_bodies_does_not_change():
    finish = finish_of(standing())
    finished = finish(finish.source[None], torch.ones(1, 2, len(SMALL.joints)))
    torch.testing.assert_close(finished[0], finish.source, atol=2e-4, rtol=0)


def test_bones_have_their_lengths():
    finish, scales = finish_of(standing()), uniform(0.9, 1.2)
    finished = finish(disturbed(finish, scales), scales[None])
    lengths = [
        (m[..., SMALL.bones[:, 1], :] - m[..., SMALL.bones[:, 0], :]).norm(dim=-1)
        for m in (finished[0], finish.source)
    ]
    expected = lengths[1] * scales[:, SMALL.bones[:, 1]]
    torch.testing.assert_close(lengths[0], expected, atol=1e-5, rtol=0)


@pytest.mark.parametrize("scale", [0.75, 1.0, 1.25])
def test_feet_that_stand_keep_their_place_and_height_and_none_sinks(scale):
    finish, scales = finish_of(standing()), uniform(1.0, scale)
    given = disturbed(finish, scales)
    assert np.ptp(given[0, :21, 1, ANKLES].numpy(), axis=0).max() > 0.01
    ((finished),) = finish(given, scales[None])
    stood = finished[:21, :, ANKLES]
    assert np.ptp(stood.numpy(), axis=0).max() < 1e-3
    lift = stood[..., 1] - finish.source[:21, :, ANKLES, 1]
    assert lift.min() > -1e-3
    assert lift.max() < 0.0151
    lowest = finish.source[..., 1].amin(dim=(0, 2))
    assert (finished[:, :, ANKLES, 1] - lowest[:, None]).min() > -1e-3


def knee_change(motion, source):
    """Change of the left knee's angle, degrees."""

    def angles(motion):
        hip, knee, ankle = (motion[..., SMALL.joints.index(f"left_{n}"), :].double()
                            for n in ("hip", "knee", "ankle"))  # fmt: skip
        cosine = torch.cosine_similarity(knee - hip, ankle - knee, dim=-1)
        return cosine.acos().rad2deg()

    return (angles(motion) - angles(source)).abs()


def test_knees_keep_their_angle():
    finish, scales = finish_of(standing()), uniform(1.0, 0.8)
    ((finished),) = finish(disturbed(finish, scales), scales[None])
    assert knee_change(finished, finish.source).mean() < 3


def test_an_arm_that_is_straight_for_a_moment_does_not_flip_when_it_must_bend():
    source = standing()
    shoulder, elbow, wrist = (
        SMALL.joints.index(f"left_{name}") for name in ("shoulder", "elbow", "wrist")
    )
    bend = np.full(N_FRAMES, -0.02)
    bend[15] = 0.002  # straight, and bent to the other side by the noise of a sensor
    start = source.person_a[:, shoulder]
    source.person_a[:, elbow] = start + np.stack([0.2 + 0 * bend, bend, 0 * bend], axis=1)
    source.person_a[:, wrist] = start + np.float32([0.4, 0, 0])
    finish, same = finish_of(source), torch.ones(1, 2, len(SMALL.joints))
    bodies = _Bodies(finish, finish.source[None], same)
    (arm,) = (row for row, limb in enumerate(finish.limbs) if limb[1] == elbow)
    for nearer, side in ((1.0, 1.0), (0.9, -1.0)):  # on its own body as captured; bent by more
        bodies.targets[..., arm, :] = torch.lerp(
            bodies.limb_starts()[..., arm, :], bodies.targets[..., arm, :], nearer
        )
        upper, _ = bodies.limb_bones()
        assert torch.sign(upper[0, 15, 0, arm, 1]) == side
        assert (upper[0, 14, 0, arm, 1]) < 0


def test_an_arm_that_must_reach_in_one_frame_stretches_over_several():
    finish, same = finish_of(standing()), torch.ones(1, 2, len(SMALL.joints))
    bodies = _Bodies(finish, finish.source[None], same)
    (arm,) = (n for n, limb in enumerate(finish.limbs) if SMALL.joints[limb[1]] == "left_elbow")
    as_source = bodies.targets.clone()
    bodies.targets[:, 15:, 0, arm] += 0.5 * (as_source - bodies.limb_starts())[:, 15:, 0, arm]

    def bends(bones):
        first, second = (motion[0, ..., arm, :] for motion in bones)
        return torch.rad2deg(
            torch.arccos((normalize(first, dim=-1) * normalize(second, dim=-1)).sum(-1))
        )

    reached = bends(bodies.limb_bones())[:, 0]
    bodies.targets = as_source
    captured = bends(bodies.limb_bones())[:, 0]
    assert (reached - captured)[20:].abs().max() > 12
    excess = reached.diff().abs() - captured.diff().abs()
    assert excess.max() < MAX_BEND_SPEED / finish.fps + 0.5
    assert (reached - captured)[:5].abs().max() < 0.5


def test_slowed_values_are_the_middle_of_the_envelopes_and_slow_ones_stay():
    values = torch.randn(2, 40, 3, generator=generator(1)).cumsum(dim=1)
    apart = (torch.arange(40)[:, None] - torch.arange(40)).abs()[:, :, None]
    rises = (values[:, None] - 0.5 * apart).amax(dim=2), (values[:, None] + 0.5 * apart).amin(dim=2)
    torch.testing.assert_close(slowed(values, 0.5), sum(rises) / 2)
    assert slowed(values, 0.5).diff(dim=1).abs().max() < 0.5 + 1e-5
    slow = 0.1 * torch.sin(values)
    torch.testing.assert_close(slowed(slow, 0.3), slow)


def test_the_middle_of_a_bent_limb_is_as_far_from_the_line_as_in_a_right_triangle():
    height = bend_height(torch.tensor(5.0), torch.tensor(3.0), torch.tensor(4.0))
    assert float(height) == pytest.approx(12 / 5)
    straight = bend_height(torch.tensor(7.0), torch.tensor(3.0), torch.tensor(4.0))
    assert float(straight) == pytest.approx(0, abs=1e-3)


def test_hands_that_touch_touch_on_other_bodies():
    source = standing()
    elbow, wrist = (SMALL.joints.index(f"left_{name}") for name in ("elbow", "wrist"))
    partner = SMALL.joints.index("right_wrist")
    shift = source.person_a[:, wrist] + [0.03, 0, 0] - source.person_b[:, partner]
    source = replace(source, person_b=(source.person_b + shift.mean(axis=0)).astype(np.float32))
    finish, scales = finish_of(source), uniform(1.0, 0.9)
    near = (finish.source[:, 0, wrist] - finish.source[:, 1, partner]).norm(dim=-1) < 0.1
    assert near.sum() >= 5
    given = disturbed(finish, scales)
    ((finished),) = finish(given, scales[None])

    def error(motion):
        change = motion - finish.source
        return (change[:, 0, wrist] - change[:, 1, partner]).norm(dim=-1)[near]

    assert error(given[0]).mean() > 0.03
    assert error(finished).mean() < 0.25 * error(given[0]).mean()
    del elbow


def test_it_turns_with_the_scene():
    finish, scales = finish_of(standing()), uniform(1.1, 0.85)
    given = disturbed(finish, scales)
    turn = torch.tensor([[0.6, 0.0, 0.8], [0.0, 1.0, 0.0], [-0.8, 0.0, 0.6]])
    there = replace(finish, source=finish.source @ turn)(given @ turn, scales[None])
    torch.testing.assert_close(there, finish(given, scales[None]) @ turn, atol=2e-4, rtol=0)


def test_a_limb_of_other_lengths_has_the_same_angle():
    """Oracle: a right angle, whose sides 3 and 4 span 5."""
    first, second = torch.tensor([1.0, 0, 0]), torch.tensor([0, 2.0, 0])
    length = bent_length(first, second, torch.tensor(3.0), torch.tensor(4.0))
    torch.testing.assert_close(length, torch.tensor(5.0))


def test_vectors_turn_with_the_axis():
    axis, to = torch.randn(2, 7, 3, generator=generator())
    rotated = turned(axis, axis, to)
    expected = torch.nn.functional.normalize(to, dim=-1) * axis.norm(dim=-1, keepdim=True)
    torch.testing.assert_close(rotated, expected)
    normal = torch.linalg.cross(axis, to)
    torch.testing.assert_close(turned(normal, axis, to), normal, atol=1e-5, rtol=1e-4)


def test_a_reach_grows_ever_slower_towards_the_straight_limb_and_a_supporting_one_not():
    reach, bent, straight = torch.linspace(0.1, 3, 500), torch.tensor(0.4), torch.tensor(0.5)
    free = soften(reach, bent, straight, torch.tensor(0.0))
    assert torch.equal(free[reach <= bent], reach[reach <= bent])
    assert bool((free < straight + 1e-6).all()) and bool((free.diff() >= -1e-6).all())
    slope = free.diff() / reach.diff()
    assert bool((slope.diff() <= 1e-3).all())  # no kink at its own reach, and none at the straight
    torch.testing.assert_close(soften(reach, bent, straight, torch.tensor(1.0)), reach)


def test_with_one_leg_longer_hips_tilt_and_the_body_stays_where_it_stood():
    """The source's legs have the same length: 4 cm are 2 cm for each hip to rise and to sink."""
    source = standing()
    legs = [SMALL.joints.index(f"{side}_{name}") for side in SIDES for name in ("knee", "ankle")]
    finish, scales = finish_of(source), uniform(1.0, 1.0)
    lengths = (finish.source[0, 1, legs] - finish.source[0, 1, np.array(legs) - 1]).norm(dim=-1)
    scales[1, legs[:2]] += 0.04 / lengths[:2].sum()
    given = disturbed(finish, scales, size=0.0)
    ((finished),) = finish(given, scales[None])
    moved = (finished - given[0])[:21, 1, SMALL.root]
    assert moved[:, [0, 2]].norm(dim=-1).max() < 0.02

    def tilt(motion):
        left, right = (motion[:21, 1, SMALL.joints.index(f"{side}_hip"), 1] for side in SIDES)
        return (left - right).mean()

    assert 0.01 < tilt(finished) - tilt(given[0]) < 0.04
    assert knee_change(finished, finish.source)[:21].mean() < 1
