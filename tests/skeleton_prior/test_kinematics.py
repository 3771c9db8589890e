"""Oracle: bone lengths, the law of cosines, and forward kinematics joint by joint."""

import hypothesis.strategies as st
import numpy as np
import pytest
import torch
from hypothesis import given, settings

from pacmo_core.data.skeleton import DUET15, NTU25
from pacmo_core.skeleton_prior.kinematics import KinematicOutput, find_limbs, two_bone_ik
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
def test_an_output_of_zero_is_the_scaled_posture(seed):
    kinematics, template, scales, output = case(seed)
    posture = kinematics.scaled_posture(template, scales)
    bones = kinematics.bone_vectors(template) * scales[:, None, :, None]
    torch.testing.assert_close(kinematics.bone_vectors(posture), bones, atol=1e-6, rtol=0)
    torch.testing.assert_close(posture[:, :, SMALL.root], template[:, :, SMALL.root])
    positions = kinematics(torch.zeros_like(output), template, scales)
    torch.testing.assert_close(positions, posture, atol=3e-4, rtol=0)


@FIXED
@given(st.integers(0, 1000))
def test_hands_and_feet_reach_where_the_output_moves_them(seed):
    kinematics, template, scales, output = case(seed, 0.97, 1.03)
    output = 0.04 * output
    positions = kinematics(output, template, scales)
    starts, middles, ends = kinematics.limbs.T
    bones = positions[:, :, middles] - positions[:, :, starts]
    lower = positions[:, :, ends] - positions[:, :, middles]
    wanted = (kinematics.scaled_posture(template, scales) + output)[:, :, ends]
    expected = (wanted - positions[:, :, starts]).norm(dim=-1)
    reach, least = bones.norm(dim=-1) + lower.norm(dim=-1), bones.norm(dim=-1) - lower.norm(dim=-1)
    within = (expected < 0.998 * reach) & (expected > 1.01 * least.abs() + 1e-3)
    missed = (positions[:, :, ends] - wanted).norm(dim=-1)
    assert missed[within].max() < 1e-4


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


def test_an_output_at_a_hand_displaces_it():
    _, template, scales, _ = case(2)
    limbs = find_limbs(SMALL, interaction(2).person_a)
    kinematics = KinematicOutput(SMALL, limbs)
    start, _, end = limbs[0]
    output = torch.zeros_like(template)
    posture = kinematics.scaled_posture(template, scales)
    output[:, :, end] = 0.1 * (posture[:, :, start] - posture[:, :, end])
    expected = posture[:, :, end] + output[:, :, end]
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
