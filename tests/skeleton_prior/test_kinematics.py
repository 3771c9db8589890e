"""Oracle: bone lengths, the law of cosines, and forward kinematics joint by joint."""

import math

import hypothesis
import hypothesis.strategies as st
import numpy as np
import pytest
import torch
from hypothesis import given, settings

from pacmo_core.data.skeleton import DUET15, NTU25
from pacmo_core.skeleton_prior.kinematics import (
    ANGLE_SHARE,
    MIDDLE_JOINT_COST,
    DisplacementOutput,
    KinematicOutput,
    find_limbs,
    limb_resistance,
    mesh_residual_features,
    mesh_root_shift,
    shift_to_reach,
    two_bone_ik,
)
from tests.skeleton_prior.examples import SMALL, generator, interaction
from tests.skeleton_prior.reference import ReferenceKinematics

FIXED = settings(derandomize=True, deadline=None, max_examples=30)


def case(seed: int, least: float = 0.65, most: float = 1.3):
    """Draw a template (B, T, J, 3), scales (B, J) and a decoder output."""
    random = generator(seed)
    motion = torch.from_numpy(interaction(seed).person_a)
    template = torch.stack([motion, motion.flip(0)])
    scales = least + (most - least) * torch.rand(2, template.shape[2], generator=random)
    scales[:, SMALL.root] = 1
    output = 0.5 * torch.randn(template.shape, generator=random)
    kinematics = KinematicOutput(SMALL, find_limbs(SMALL, interaction(seed).person_a))
    return kinematics, template, scales, output


@FIXED
@given(st.integers(0, 1000))
def test_bone_lengths_are_exact_for_any_output(seed):
    kinematics, template, scales, output = case(seed)
    positions = kinematics(output, template, scales)
    expected = kinematics.bone_vectors(template).norm(dim=-1) * scales[:, None]
    torch.testing.assert_close(
        kinematics.bone_vectors(positions).norm(dim=-1), expected, atol=2e-6, rtol=1e-5
    )


@FIXED
@given(st.integers(0, 1000))
def test_a_zero_output_at_scale_one_is_the_template(seed):
    kinematics, template, scales, output = case(seed)
    positions = kinematics(torch.zeros_like(output), template, torch.ones_like(scales))
    # The angle of a nearly straight limb is accurate to the square root of float32 precision.
    torch.testing.assert_close(positions, template, atol=3e-4, rtol=0)


@FIXED
@given(st.integers(0, 1000))
def test_hands_and_feet_stay_in_place_within_reach(seed):
    kinematics, template, scales, _ = case(seed, 0.97, 1.03)
    positions = kinematics.ik_retarget(template, scales)
    starts, middles, ends = kinematics.limbs.T
    bones = positions[:, :, middles] - positions[:, :, starts]
    lower = positions[:, :, ends] - positions[:, :, middles]
    expected = (template[:, :, ends] - positions[:, :, starts]).norm(dim=-1)
    reach, least = bones.norm(dim=-1) + lower.norm(dim=-1), bones.norm(dim=-1) - lower.norm(dim=-1)
    within = (expected < 0.998 * reach) & (expected > 1.01 * least.abs() + 1e-3)
    missed = (positions[:, :, ends] - template[:, :, ends]).norm(dim=-1)
    assert missed[within].max() < 1e-4


def test_displacements_are_added_to_the_template():
    _, template, scales, output = case(0)
    assert torch.equal(DisplacementOutput()(output, template, scales), template + output)


@FIXED
@given(st.floats(0.1, 2), st.floats(0.1, 2), st.floats(0, 5), st.integers(0, 100))
def test_two_bone_ik_keeps_lengths_and_reaches_the_target(upper, lower, distance, seed):
    random = generator(seed)
    offset = torch.nn.functional.normalize(torch.randn(3, generator=random), dim=0) * distance
    pole = torch.randn(3, generator=random)
    first, second = two_bone_ik(
        offset.double(), torch.tensor(upper).double(), torch.tensor(lower).double(), pole.double()
    )
    assert float(first.norm()) == pytest.approx(upper, rel=1e-3)
    assert float(second.norm()) == pytest.approx(lower, rel=1e-3)
    reached = float((first + second).norm())
    nearest = min(max(distance, abs(upper - lower)), upper + lower)
    assert reached == pytest.approx(nearest, abs=0.01 * (upper + lower))
    if distance > 0.1:  # towards the pole
        ahead = torch.nn.functional.normalize(offset.double(), dim=0)
        across = pole.double() - (pole.double() @ ahead) * ahead
        assert float(first @ across) >= -1e-6


@pytest.mark.parametrize("offset", [(0.0, -0.1, 0.0), (0.1, 0.0, 0.0), (0.06, 0.0, -0.08)])
@pytest.mark.parametrize("along", [0.0, 1.0])
def test_a_straight_limb_bends_to_reach_the_target(offset, along):
    there = torch.tensor(offset)
    first, second = two_bone_ik(there, torch.tensor(0.3), torch.tensor(0.3), along * there)
    torch.testing.assert_close(first + second, there, atol=1e-5, rtol=0)
    torch.testing.assert_close(torch.stack([first, second]).norm(dim=-1), torch.full((2,), 0.3))


def test_a_body_sinks_to_bring_its_feet_within_reach():
    start, end = torch.tensor([[0.0, 1.0, 0.0]]), torch.tensor([[0.0, 0.0, 0.0]])
    moved = shift_to_reach(start, end, torch.tensor([0.8]))
    torch.testing.assert_close(moved, torch.tensor([0.0, -0.2, 0.0]))
    still = shift_to_reach(start, end, torch.tensor([1.2]))
    torch.testing.assert_close(still, torch.zeros(3))
    one_of_two = shift_to_reach(start.expand(2, 3), end.expand(2, 3), torch.tensor([0.8, 1.2]))
    torch.testing.assert_close(one_of_two, moved / 2)


def test_limbs_are_found_by_bone_lengths():
    def named(skeleton, motion):
        limbs = find_limbs(skeleton, motion)
        return {tuple(skeleton.joints[i] for i in limb) for limb in limbs}

    expected = {
        (f"{side}_{a}", f"{side}_{b}", f"{side}_{c}")
        for side in ("left", "right")
        for a, b, c in (("hip", "knee", "ankle"), ("shoulder", "elbow", "wrist"))
    }
    assert named(SMALL, interaction().person_a) == expected
    ntu = np.zeros((1, 25, 3), dtype=np.float32)
    long = {"elbow", "wrist", "knee", "ankle"}
    for joint in NTU25.order[1:]:
        size = 0.4 if NTU25.joints[joint].partition("_")[2] in long else 0.1
        ntu[:, joint] = ntu[:, NTU25.parents[joint]] + [0, size, 0]
    assert named(NTU25, ntu) == expected
    assert (
        len(find_limbs(DUET15, np.random.default_rng(0).normal(size=(2, 15, 3)).astype("f"))) == 4
    )


def test_a_skeleton_without_limbs_has_exact_bone_lengths_too():
    _, template, scales, output = case(0)
    kinematics = KinematicOutput(SMALL, ())
    positions = kinematics(output, template, scales)
    expected = kinematics.bone_vectors(template).norm(dim=-1) * scales[:, None]
    torch.testing.assert_close(
        kinematics.bone_vectors(positions).norm(dim=-1), expected, atol=2e-6, rtol=1e-5
    )
    start = kinematics.initial_output(template[:, :, 1], template, scales)
    torch.testing.assert_close(start[:, :, SMALL.root], template[:, :, 1])


def test_the_ancestor_matrix_equals_forward_kinematics_joint_by_joint():
    kinematics, template, scales, output = case(0)
    limbs = tuple((a, b, c) for a, b, c in kinematics.limbs.tolist())
    torch.testing.assert_close(
        kinematics(output, template, scales),
        ReferenceKinematics(SMALL, limbs)(output, template, scales),
    )


def test_a_moving_root_leaves_hands_and_feet_in_place():
    _, template, _, _ = case(1)
    limbs = find_limbs(SMALL, interaction(1).person_a)
    kinematics, ones = (
        KinematicOutput(SMALL, limbs),
        torch.ones(template.shape[0], template.shape[2]),
    )
    ends = [end for _, _, end in limbs]
    shorter = template.clone()
    for start, middle, end in limbs:  # bent limbs, not fully extended
        shorter[:, :, end] = template[:, :, start] + 0.8 * (
            template[:, :, middle] - template[:, :, start]
        ).norm(dim=-1, keepdim=True) * torch.tensor([0.0, -1.0, 0.0])
    output = torch.zeros_like(template)
    output[:, :, SMALL.root] = torch.tensor([0.01, 0.0, -0.02])
    moved = kinematics(output, shorter, ones) - shorter
    torch.testing.assert_close(moved[:, :, ends], torch.zeros(()).expand(moved[:, :, ends].shape))
    torch.testing.assert_close(
        moved[:, :, SMALL.root], output[:, :, SMALL.root], atol=1e-6, rtol=1e-5
    )


@FIXED
@given(st.integers(0, 1000))
def test_the_root_shift_makes_the_mean_mesh_residual_zero(seed):
    random = generator(seed)
    own, partner, change = torch.randn(3, 1, 4, 15, 3, generator=random)
    shift = mesh_root_shift(own, partner, change)
    residuals = mesh_residual_features(own, partner, shift[:, :, None].expand_as(own), change)[
        ..., :3
    ]
    torch.testing.assert_close(residuals.mean(dim=2), torch.zeros_like(shift), atol=1e-6, rtol=0)


def standing_on_one(
    template: torch.Tensor, kinematics: KinematicOutput, height: float
) -> torch.Tensor:
    """Place the body on its first limb, middle joint at a height; other limbs in the air."""
    start, middle, end = kinematics.limbs[0]
    template[:, :, end] = torch.tensor([0.3, 0.0, 0.1])
    template[:, :, start] = template[:, :, end] + torch.tensor([0.0, 0.8, 0.0])
    template[:, :, middle] = template[:, :, end] + torch.tensor([height, 0.4, 0.0])
    template[:, :, kinematics.limbs[1:, 2], 1] = 5.0
    return template


def expected_resistance(height: float, closed: float) -> float:
    """Resistance of a leg 0.8 m long, from its knee's distance to the axis before and after.

    It minimises the squares of the remaining shift and of the knee's shift, weighted, for a knee
    that moves equally far for each metre.
    """
    thigh = math.hypot(0.4, height)
    then = math.sqrt(max(thigh**2 - ((0.8 - closed) / 2) ** 2, 0))
    gradient = abs(then - height) / abs(closed)
    return 1 - 1 / (1 + MIDDLE_JOINT_COST * gradient**2)


@FIXED
@given(st.floats(0.01, 0.4), st.floats(-0.01, 0.3))
def test_a_legs_resistance_follows_its_knees_displacement(height, closed):
    closed = max(closed, 0.8 - 2 * math.hypot(0.4, height))
    hypothesis.assume(abs(closed) > 1e-3)
    leg = torch.tensor([[0, 0.8, 0], [height, 0.4, 0], [0, 0, 0]], dtype=torch.float64)
    asked = torch.tensor([0.1, -closed, 0.2], dtype=torch.float64)
    axis, resistance = limb_resistance(*leg, shift=asked)
    torch.testing.assert_close(axis, torch.tensor([0.0, -1.0, 0.0]).double())
    assert float(resistance) == pytest.approx(expected_resistance(height, closed), rel=1e-4)


def test_a_straight_leg_extends_no_further():
    leg = torch.tensor([[0, 0.8, 0], [0, 0.4, 0], [0, 0, 0]])
    _, resistance = limb_resistance(*leg, shift=torch.tensor([0.0, 0.1, 0.0]))
    assert float(resistance) == pytest.approx(1, abs=1e-6)


@pytest.mark.parametrize("height", [0.0, 0.1, 0.4])
def test_a_body_follows_the_shift_less_the_resistance_of_legs_in_stance(height):
    kinematics, template, scales, _ = case(2)
    template = standing_on_one(template, kinematics, height)
    shift = torch.tensor([0.02, -0.03, 0.01]).expand(*template.shape[:2], 3)
    output = kinematics.initial_output(shift, template, torch.ones_like(scales))
    expected = shift * torch.tensor([1.0, 1 - expected_resistance(height, 0.03), 1.0])
    torch.testing.assert_close(output[:, :, kinematics.root], expected, atol=1e-5, rtol=1e-4)
    ends = kinematics.limbs[:, 2]
    torch.testing.assert_close(output[:, :, ends[0]], torch.zeros_like(shift))
    torch.testing.assert_close(output[:, :, ends[1]], (shift + expected) / 2, atol=1e-5, rtol=1e-4)


@pytest.mark.parametrize("height", [0.0, 0.1, 0.4])
def test_a_longer_leg_raises_the_body_more_the_straighter_it_is(height):
    kinematics, template, scales, _ = case(2)
    template = standing_on_one(template, kinematics, height)
    longer = torch.ones_like(scales)
    longer[:, kinematics.limbs[0, 1:]] = 1.2
    zero_shift = torch.zeros(*template.shape[:2], 3)
    output = kinematics.initial_output(zero_shift, template, longer)
    share = ANGLE_SHARE + (1 - ANGLE_SHARE) * expected_resistance(height, 0.16)
    expected = torch.tensor([0.0, share * 0.16, 0.0]).expand_as(zero_shift)
    torch.testing.assert_close(output[:, :, kinematics.root], expected, atol=1e-3, rtol=0)


def test_a_body_rises_no_further_than_its_legs_reach():
    kinematics, template, scales, _ = case(2)
    template = standing_on_one(template, kinematics, 0.1)
    up = torch.tensor([0.0, 0.5, 0.0]).expand(*template.shape[:2], 3)
    output = kinematics.initial_output(up, template, torch.ones_like(scales))
    straight = 2 * math.hypot(0.4, 0.1) - 0.8
    expected = torch.tensor([0.0, straight, 0.0]).expand_as(up)
    torch.testing.assert_close(output[:, :, kinematics.root], expected, atol=1e-5, rtol=0)


def test_a_longer_arm_reaches_further_by_a_share_of_its_growth():
    kinematics, template, scales, _ = case(2)
    start, middle, end = kinematics.limbs[0]
    template[..., 1] += 5.0
    longer = torch.ones_like(scales)
    longer[:, [middle, end]] = 1.2
    zero_shift = torch.zeros(*template.shape[:2], 3)
    output = kinematics.initial_output(zero_shift, template, longer)
    torch.testing.assert_close(output[:, :, kinematics.root], zero_shift)
    expected = ANGLE_SHARE * 0.2 * (template[:, :, end] - template[:, :, start])
    torch.testing.assert_close(output[:, :, end], expected)


def test_an_output_at_a_hand_displaces_it():
    _, template, scales, _ = case(2)
    limbs = find_limbs(SMALL, interaction(2).person_a)
    kinematics = KinematicOutput(SMALL, limbs)
    start, _, end = limbs[0]
    output = torch.zeros_like(template)
    estimate = kinematics.ik_retarget(template, scales)
    output[:, :, end] = (
        0.9 * estimate[:, :, end] + 0.1 * estimate[:, :, start] - template[:, :, end]
    )
    expected = template[:, :, end] + output[:, :, end]
    torch.testing.assert_close(kinematics(output, template, scales)[:, :, end], expected)


def test_a_straight_limb_has_a_finite_gradient():
    _, template, scales, output = case(3)
    straight = template.clone()
    for start, middle, end in find_limbs(SMALL, interaction(3).person_a):
        straight[:, :, end] = 2 * straight[:, :, middle] - straight[:, :, start]
    kinematics = KinematicOutput(SMALL, find_limbs(SMALL, interaction(3).person_a))
    small = (0 * output).requires_grad_()
    kinematics(small, straight, scales).square().sum().backward()
    assert small.grad is not None and small.grad.isfinite().all()
    assert small.grad.abs().max() < 1e3 * straight.abs().max()
