"""Reference: the names of the joints of known skeletons."""

import numpy as np
import pytest

from pacmo_core.data.skeleton import DUET15, EXPI18, INTERHUMAN22, NTU25, SBU15
from pacmo_core.interaction_mesh import Scene
from pacmo_core.interaction_mesh.body_parts import (
    RIGID,
    ancestor_bones,
    capsule_radii,
    hinges,
    is_hand,
    scene_bone_kinds,
    trunk_bends,
    trunk_joints,
)
from tests.data.test_segments import CMU22, DUO27, PRIOR17, tree
from tests.interaction_mesh.scenes import scene

# Joints of the ZED camera's BODY_34.
ZED34 = tree(
    "zed34",
    "pelvis naval_spine<pelvis chest_spine<naval_spine neck<chest_spine left_clavicle<chest_spine"
    " left_shoulder<left_clavicle left_elbow<left_shoulder left_wrist<left_elbow"
    " left_hand<left_wrist left_hand_tip<left_hand left_thumb<left_hand"
    " right_clavicle<chest_spine right_shoulder<right_clavicle right_elbow<right_shoulder"
    " right_wrist<right_elbow right_hand<right_wrist right_hand_tip<right_hand"
    " right_thumb<right_hand left_hip<pelvis left_knee<left_hip left_ankle<left_knee"
    " left_foot<left_ankle right_hip<pelvis right_knee<right_hip right_ankle<right_knee"
    " right_foot<right_ankle head<neck nose<head left_eye<nose left_ear<left_eye right_eye<nose"
    " right_ear<right_eye left_heel<left_ankle right_heel<right_ankle",
)


@pytest.mark.parametrize(
    ("skeleton", "middle"),
    [
        (NTU25, "left_elbow left_knee right_elbow right_knee"),
        (SBU15, "left_elbow left_knee right_elbow right_knee"),
        (DUET15, "left_elbow left_knee right_elbow right_knee"),
        (INTERHUMAN22, "left_elbow left_knee right_elbow right_knee"),
    ],
)
def test_hinges_are_elbows_and_knees(skeleton, middle):
    assert hinge_names(skeleton) == sorted(middle.split())


def hinge_names(skeleton):
    """Lay a grown-up's bones along a line of the tree and name the hinges of person a."""
    source = person(skeleton)
    result = source.bones[hinges(source)[0][:, 1], 0]
    return sorted(skeleton.joints[i] for i in result if i < len(skeleton.joints))


def person(skeleton):
    lengths = {"elbow": 0.28, "wrist": 0.25, "knee": 0.42, "ankle": 0.42, "hip": 0.12, "foot": 0.15}
    if skeleton is SBU15:
        lengths |= {"hand": 0.25, "foot": 0.42, "hip": 0.3}
    random = np.random.default_rng(0)
    pose = np.zeros((1, len(skeleton.joints), 3))
    for joint in skeleton.order[1:]:
        direction = random.normal(size=3)
        name = skeleton.joints[joint].rpartition("_")[2]
        length = lengths.get(name, 0.1)
        pose[:, joint] = pose[:, skeleton.parents[joint]] + length * direction / np.linalg.norm(
            direction
        )
    motion = pose.astype(np.float32)
    return Scene((motion, motion + np.float32(1)), (skeleton, skeleton), 30.0)


SKELETONS = [NTU25, SBU15, DUET15, INTERHUMAN22, EXPI18, DUO27, CMU22, PRIOR17, ZED34]


@pytest.mark.parametrize("skeleton", SKELETONS, ids=lambda s: s.name)
def test_every_skeleton_has_two_of_each_limb_hands_and_a_trunk(skeleton):
    source = person(skeleton)
    kinds = scene_bone_kinds(source)[: len(skeleton.bones)]
    for kind in ("thigh", "shin", "upper_arm", "forearm"):
        assert kinds.count(kind) == 2
    assert "trunk" in kinds
    n_hands = kinds.count("hand") + 2
    assert is_hand(source)[: len(skeleton.joints)].sum() == n_hands
    assert len(hinges(source)[0]) == 8
    assert (capsule_radii(source) > 0).all()


@pytest.mark.parametrize("skeleton", [NTU25, INTERHUMAN22])
def test_a_trunk_extends_from_the_root_to_hips_and_shoulders_without_limbs(skeleton):
    a, b = trunk_joints(person(skeleton))
    np.testing.assert_array_equal(b, a + len(skeleton.joints))
    names = {skeleton.joints[i] for i in a}
    assert skeleton.joints[skeleton.root] in names
    assert {"left_hip", "right_hip", "left_shoulder", "right_shoulder"} <= names
    assert not any(part in name for name in names for part in ("elbow", "knee", "wrist", "head"))


@pytest.mark.parametrize("skeleton", SKELETONS, ids=lambda s: s.name)
def test_the_bones_of_a_pelvis_or_chest_are_rigid_and_those_of_the_spine_bend(skeleton):
    source = person(skeleton)
    pairs, kinds = trunk_bends(source)
    joints = np.concatenate([skeleton.joints, skeleton.joints])
    thighs = np.flatnonzero(np.array(scene_bone_kinds(source)) == "thigh")
    hips = set(joints[source.bones[thighs, 0]])
    ends = [set(joints[source.bones[pair, 1]]) for pair in pairs[kinds == RIGID]]
    assert hips in ends
    for (first, second), kind in zip(source.bones[pairs], kinds, strict=True):
        assert (first[0] == second[0]) if kind == RIGID else (first[1] == second[0])
        assert not any("elbow" in joints[end] or "knee" in joints[end] for end in (*first, *second))


def test_a_joint_is_the_sum_of_its_ancestor_bones():
    source = scene()
    result = ancestor_bones(source) @ source.bone_vectors.transpose(1, 0, 2).reshape(10, -1)
    roots = np.repeat(source.points[:, [0, 6]], 6, axis=1)
    expected = (source.points - roots).transpose(1, 0, 2).reshape(12, -1)
    np.testing.assert_allclose(result, expected, atol=1e-12)
