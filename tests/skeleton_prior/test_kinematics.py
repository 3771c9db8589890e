"""What is trusted: bones' lengths, the law of cosines, joints placed one by one."""

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
    """Draw a template (B, T, J, 3), scales (B, J) and a field."""
    random = generator(seed)
    motion = torch.from_numpy(interaction(seed).person_a)
    template = torch.stack([motion, motion.flip(0)])
    scales = least + (most - least) * torch.rand(2, template.shape[2], generator=random)
    scales[:, SMALL.root] = 1
    field = 0.5 * torch.randn(template.shape, generator=random)
    tree = KinematicOutput(SMALL, find_limbs(SMALL, interaction(seed).person_a))
    return tree, template, scales, field


@FIXED
@given(st.integers(0, 1000))
def test_every_bone_is_right_whatever_the_network_says(seed):
    tree, template, scales, field = case(seed)
    placed = tree(field, template, scales)
    wanted = tree.bone_vectors(template).norm(dim=-1) * scales[:, None]
    torch.testing.assert_close(tree.bone_vectors(placed).norm(dim=-1), wanted, atol=2e-6, rtol=1e-5)


@FIXED
@given(st.integers(0, 1000))
def test_a_field_of_zero_on_the_same_body_is_the_template(seed):
    tree, template, scales, field = case(seed)
    placed = tree(torch.zeros_like(field), template, torch.ones_like(scales))
    # The angle of a nearly straight limb is known to the root of single precision.
    torch.testing.assert_close(placed, template, atol=3e-4, rtol=0)


@FIXED
@given(st.integers(0, 1000))
def test_hands_and_feet_stay_where_limbs_reach(seed):
    tree, template, scales, _ = case(seed, 0.97, 1.03)
    placed = tree.ik_retarget(template, scales)
    starts, middles, ends = tree.limbs.T
    bones = placed[:, :, middles] - placed[:, :, starts]
    lower = placed[:, :, ends] - placed[:, :, middles]
    wanted = (template[:, :, ends] - placed[:, :, starts]).norm(dim=-1)
    reach, least = bones.norm(dim=-1) + lower.norm(dim=-1), bones.norm(dim=-1) - lower.norm(dim=-1)
    within = (wanted < 0.998 * reach) & (wanted > 1.01 * least.abs() + 1e-3)
    missed = (placed[:, :, ends] - template[:, :, ends]).norm(dim=-1)
    assert missed[within].max() < 1e-4


def test_offsets_are_added_to_the_template():
    _, template, scales, field = case(0)
    assert torch.equal(DisplacementOutput()(field, template, scales), template + field)


@FIXED
@given(st.floats(0.1, 2), st.floats(0.1, 2), st.floats(0, 5), st.integers(0, 100))
def test_two_bones_keep_their_lengths_and_end_where_they_should(upper, lower, distance, seed):
    random = generator(seed)
    way = torch.nn.functional.normalize(torch.randn(3, generator=random), dim=0) * distance
    side = torch.randn(3, generator=random)
    first, second = two_bone_ik(
        way.double(), torch.tensor(upper).double(), torch.tensor(lower).double(), side.double()
    )
    assert float(first.norm()) == pytest.approx(upper, rel=1e-3)
    assert float(second.norm()) == pytest.approx(lower, rel=1e-3)
    reached = float((first + second).norm())
    nearest = min(max(distance, abs(upper - lower)), upper + lower)
    assert reached == pytest.approx(nearest, abs=0.01 * (upper + lower))
    if distance > 0.1:  # on the side that it is told
        ahead = torch.nn.functional.normalize(way.double(), dim=0)
        across = side.double() - (side.double() @ ahead) * ahead
        assert float(first @ across) >= -1e-6


@pytest.mark.parametrize("way", [(0.0, -0.1, 0.0), (0.1, 0.0, 0.0), (0.06, 0.0, -0.08)])
@pytest.mark.parametrize("along", [0.0, 1.0])
def test_a_straight_limb_bends_to_some_side_to_end_where_it_should(way, along):
    there = torch.tensor(way)
    first, second = two_bone_ik(there, torch.tensor(0.3), torch.tensor(0.3), along * there)
    torch.testing.assert_close(first + second, there, atol=1e-5, rtol=0)
    torch.testing.assert_close(torch.stack([first, second]).norm(dim=-1), torch.full((2,), 0.3))


def test_a_body_sinks_by_what_its_legs_lack():
    start, end = torch.tensor([[0.0, 1.0, 0.0]]), torch.tensor([[0.0, 0.0, 0.0]])
    moved = shift_to_reach(start, end, torch.tensor([0.8]))
    torch.testing.assert_close(moved, torch.tensor([0.0, -0.2, 0.0]))
    still = shift_to_reach(start, end, torch.tensor([1.2]))
    torch.testing.assert_close(still, torch.zeros(3))
    one_of_two = shift_to_reach(start.expand(2, 3), end.expand(2, 3), torch.tensor([0.8, 1.2]))
    torch.testing.assert_close(one_of_two, moved / 2)


def test_limbs_are_found_by_their_shape():
    def named(skeleton, motion):
        limbs = find_limbs(skeleton, motion)
        return {tuple(skeleton.joints[i] for i in limb) for limb in limbs}

    wanted = {
        (f"{side}_{a}", f"{side}_{b}", f"{side}_{c}")
        for side in ("left", "right")
        for a, b, c in (("hip", "knee", "ankle"), ("shoulder", "elbow", "wrist"))
    }
    assert named(SMALL, interaction().person_a) == wanted
    ntu = np.zeros((1, 25, 3), dtype=np.float32)
    long = {"elbow", "wrist", "knee", "ankle"}
    for joint in NTU25.order[1:]:
        size = 0.4 if NTU25.joints[joint].partition("_")[2] in long else 0.1
        ntu[:, joint] = ntu[:, NTU25.parents[joint]] + [0, size, 0]
    assert named(NTU25, ntu) == wanted
    assert (
        len(find_limbs(DUET15, np.random.default_rng(0).normal(size=(2, 15, 3)).astype("f"))) == 4
    )


def test_a_skeleton_without_limbs_is_placed_all_the_same():
    _, template, scales, field = case(0)
    tree = KinematicOutput(SMALL, ())
    placed = tree(field, template, scales)
    wanted = tree.bone_vectors(template).norm(dim=-1) * scales[:, None]
    torch.testing.assert_close(tree.bone_vectors(placed).norm(dim=-1), wanted, atol=2e-6, rtol=1e-5)
    start = tree.initial_output(template[:, :, 1], template, scales)
    torch.testing.assert_close(start[:, :, SMALL.root], template[:, :, 1])


def test_one_product_places_joints_as_going_from_joint_to_joint_does():
    tree, template, scales, field = case(0)
    limbs = tuple((a, b, c) for a, b, c in tree.limbs.tolist())
    torch.testing.assert_close(
        tree(field, template, scales), ReferenceKinematics(SMALL, limbs)(field, template, scales)
    )


def test_a_root_that_moves_leaves_hands_and_feet_in_their_places():
    _, template, _, _ = case(1)
    limbs = find_limbs(SMALL, interaction(1).person_a)
    tree, ones = KinematicOutput(SMALL, limbs), torch.ones(template.shape[0], template.shape[2])
    ends = [end for _, _, end in limbs]
    shorter = template.clone()
    for start, middle, end in limbs:  # bent limbs have some way to go
        shorter[:, :, end] = template[:, :, start] + 0.8 * (
            template[:, :, middle] - template[:, :, start]
        ).norm(dim=-1, keepdim=True) * torch.tensor([0.0, -1.0, 0.0])
    field = torch.zeros_like(template)
    field[:, :, SMALL.root] = torch.tensor([0.01, 0.0, -0.02])
    moved = tree(field, shorter, ones) - shorter
    torch.testing.assert_close(moved[:, :, ends], torch.zeros(()).expand(moved[:, :, ends].shape))
    torch.testing.assert_close(
        moved[:, :, SMALL.root], field[:, :, SMALL.root], atol=1e-6, rtol=1e-5
    )


@FIXED
@given(st.integers(0, 1000))
def test_a_body_that_comes_along_keeps_the_mesh_as_it_was_on_average(seed):
    random = generator(seed)
    own, partner, change = torch.randn(3, 1, 4, 15, 3, generator=random)
    shift = mesh_root_shift(own, partner, change)
    lags = mesh_residual_features(own, partner, shift[:, :, None].expand_as(own), change)[..., :3]
    torch.testing.assert_close(lags.mean(dim=2), torch.zeros_like(shift), atol=1e-6, rtol=0)


def standing_on_one(template: torch.Tensor, tree: KinematicOutput, aside: float) -> torch.Tensor:
    """Set a body up on its first limb, whose middle stands aside; other limbs far in the air."""
    start, middle, end = tree.limbs[0]
    template[:, :, end] = torch.tensor([0.3, 0.0, 0.1])
    template[:, :, start] = template[:, :, end] + torch.tensor([0.0, 0.8, 0.0])
    template[:, :, middle] = template[:, :, end] + torch.tensor([aside, 0.4, 0.0])
    template[:, :, tree.limbs[1:, 2], 1] = 5.0
    return template


def resisting(aside: float, closed: float) -> float:
    """How much of a way a leg 0.8 m long resists, from where its knee stands before and after.

    That is at the height which minimises the way not gone and that of the knee, weighed, squared,
    were the knee to go as far for each metre as it does for all of them.
    """
    thigh = math.hypot(0.4, aside)
    then = math.sqrt(max(thigh**2 - ((0.8 - closed) / 2) ** 2, 0))
    slope = abs(then - aside) / abs(closed)
    return 1 - 1 / (1 + MIDDLE_JOINT_COST * slope**2)


@FIXED
@given(st.floats(0.01, 0.4), st.floats(-0.01, 0.3))
def test_a_leg_resists_by_how_far_its_knee_goes_aside(aside, closed):
    closed = max(closed, 0.8 - 2 * math.hypot(0.4, aside))
    hypothesis.assume(abs(closed) > 1e-3)
    leg = torch.tensor([[0, 0.8, 0], [aside, 0.4, 0], [0, 0, 0]], dtype=torch.float64)
    asked = torch.tensor([0.1, -closed, 0.2], dtype=torch.float64)
    axis, resists = limb_resistance(*leg, shift=asked)
    torch.testing.assert_close(axis, torch.tensor([0.0, -1.0, 0.0]).double())
    assert float(resists) == pytest.approx(resisting(aside, closed), rel=1e-4)


def test_a_leg_that_is_straight_opens_no_further():
    leg = torch.tensor([[0, 0.8, 0], [0, 0.4, 0], [0, 0, 0]])
    _, resists = limb_resistance(*leg, shift=torch.tensor([0.0, 0.1, 0.0]))
    assert float(resists) == pytest.approx(1, abs=1e-6)


@pytest.mark.parametrize("aside", [0.0, 0.1, 0.4])
def test_a_body_comes_along_but_for_what_stands_and_legs_resist(aside):
    tree, template, scales, _ = case(2)
    template = standing_on_one(template, tree, aside)
    shift = torch.tensor([0.02, -0.03, 0.01]).expand(*template.shape[:2], 3)
    field = tree.initial_output(shift, template, torch.ones_like(scales))
    wanted = shift * torch.tensor([1.0, 1 - resisting(aside, 0.03), 1.0])
    torch.testing.assert_close(field[:, :, tree.root], wanted, atol=1e-5, rtol=1e-4)
    ends = tree.limbs[:, 2]
    torch.testing.assert_close(field[:, :, ends[0]], torch.zeros_like(shift))
    torch.testing.assert_close(field[:, :, ends[1]], (shift + wanted) / 2, atol=1e-5, rtol=1e-4)


@pytest.mark.parametrize("aside", [0.0, 0.1, 0.4])
def test_a_leg_that_grows_raises_the_body_all_the_more_the_straighter_it_is(aside):
    tree, template, scales, _ = case(2)
    template = standing_on_one(template, tree, aside)
    longer = torch.ones_like(scales)
    longer[:, tree.limbs[0, 1:]] = 1.2
    nowhere = torch.zeros(*template.shape[:2], 3)
    field = tree.initial_output(nowhere, template, longer)
    share = ANGLE_SHARE + (1 - ANGLE_SHARE) * resisting(aside, 0.16)
    wanted = torch.tensor([0.0, share * 0.16, 0.0]).expand_as(nowhere)
    torch.testing.assert_close(field[:, :, tree.root], wanted, atol=1e-3, rtol=0)


def test_a_body_rises_no_further_than_its_legs_reach():
    tree, template, scales, _ = case(2)
    template = standing_on_one(template, tree, 0.1)
    up = torch.tensor([0.0, 0.5, 0.0]).expand(*template.shape[:2], 3)
    field = tree.initial_output(up, template, torch.ones_like(scales))
    straight = 2 * math.hypot(0.4, 0.1) - 0.8
    wanted = torch.tensor([0.0, straight, 0.0]).expand_as(up)
    torch.testing.assert_close(field[:, :, tree.root], wanted, atol=1e-5, rtol=0)


def test_an_arm_that_grows_reaches_further_by_a_part_of_it():
    tree, template, scales, _ = case(2)
    start, middle, end = tree.limbs[0]
    template[..., 1] += 5.0
    longer = torch.ones_like(scales)
    longer[:, [middle, end]] = 1.2
    nowhere = torch.zeros(*template.shape[:2], 3)
    field = tree.initial_output(nowhere, template, longer)
    torch.testing.assert_close(field[:, :, tree.root], nowhere)
    wanted = ANGLE_SHARE * 0.2 * (template[:, :, end] - template[:, :, start])
    torch.testing.assert_close(field[:, :, end], wanted)


def test_a_field_at_a_hand_takes_it_there():
    _, template, scales, _ = case(2)
    limbs = find_limbs(SMALL, interaction(2).person_a)
    tree = KinematicOutput(SMALL, limbs)
    start, _, end = limbs[0]
    field = torch.zeros_like(template)
    guess = tree.ik_retarget(template, scales)
    field[:, :, end] = 0.9 * guess[:, :, end] + 0.1 * guess[:, :, start] - template[:, :, end]
    wanted = template[:, :, end] + field[:, :, end]
    torch.testing.assert_close(tree(field, template, scales)[:, :, end], wanted)


def test_a_limb_that_is_straight_has_a_slope_that_is_a_number():
    _, template, scales, field = case(3)
    straight = template.clone()
    for start, middle, end in find_limbs(SMALL, interaction(3).person_a):
        straight[:, :, end] = 2 * straight[:, :, middle] - straight[:, :, start]
    tree = KinematicOutput(SMALL, find_limbs(SMALL, interaction(3).person_a))
    small = (0 * field).requires_grad_()
    tree(small, straight, scales).square().sum().backward()
    assert small.grad is not None and small.grad.isfinite().all()
    assert small.grad.abs().max() < 1e3 * straight.abs().max()
