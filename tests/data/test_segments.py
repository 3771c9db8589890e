"""Truth: what a bone is, as the datasets' own figures and papers show it."""

import pytest

from pacmo_core.data.segments import segments
from pacmo_core.data.skeleton import (
    DUET15,
    EXPI18,
    INTERHUMAN22,
    NTU25,
    SBU15,
    Skeleton,
    mirror_by_name,
)
from tests.formats.rigged import mixamo, people


def tree(name: str, words: str) -> Skeleton:
    """Build a skeleton from words ``joint<parent``."""
    pairs = [word.partition("<") for word in words.split()]
    joints = tuple(joint for joint, _, _ in pairs)
    parents = tuple(joints.index(parent) if parent else -1 for _, _, parent in pairs)
    return Skeleton(name, joints, parents, mirror_by_name(joints))


DUO27 = tree(
    "duo27",
    "Hips Spine<Hips Spine1<Spine Spine2<Spine1 Spine3<Spine2 Neck<Spine3 Head<Neck"
    " RightShoulder<Spine3 RightArm<RightShoulder RightForeArm<RightArm RightHand<RightForeArm"
    " RightHandEnd<RightHand RightHandThumb1<RightHand"
    " LeftShoulder<Spine3 LeftArm<LeftShoulder LeftForeArm<LeftArm LeftHand<LeftForeArm"
    " LeftHandEnd<LeftHand LeftHandThumb1<LeftHand"
    " RightUpLeg<Hips RightLeg<RightUpLeg RightFoot<RightLeg RightToeBase<RightFoot"
    " LeftUpLeg<Hips LeftLeg<LeftUpLeg LeftFoot<LeftLeg LeftToeBase<LeftFoot",
)
CMU22 = tree(
    "cmu22",
    "root lhip<root lknee<lhip lankle<lknee ltoe<lankle rhip<root rknee<rhip rankle<rknee"
    " rtoe<rankle lowerback<root upperback<lowerback chest<upperback lowerneck<chest"
    " upperneck<lowerneck lclavicle<chest lshoulder<lclavicle lelbow<lshoulder lwrist<lelbow"
    " rclavicle<chest rshoulder<rclavicle relbow<rshoulder rwrist<relbow",
)
# The augmentation paper's second family; a letter of its files is missing.
PRIOR17 = tree(
    "prior17",
    "Hip Head<Hip Head_end<Head LeftShoulder<Head LeftHand<LeftShoulder LeftHand_end<LeftHand"
    " RightShoulder<Head RghtHand<RightShoulder RghtHand_end<RghtHand"
    " LeftHip<Hip LeftKnee<LeftHip LeftFoot<LeftKnee LeftFoot_end<LeftFoot"
    " RightHip<Hip RightKnee<RightHip RightFoot<RightKnee RightFoot_end<RightFoot",
)
ACCLAIM = tree(
    "acclaim",
    "root lhipjoint<root lfemur<lhipjoint ltibia<lfemur lfoot<ltibia ltoes<lfoot"
    " rhipjoint<root rfemur<rhipjoint rtibia<rfemur rfoot<rtibia rtoes<rfoot"
    " lowerback<root thorax<lowerback head<thorax"
    " lclavicle<thorax lhumerus<lclavicle lradius<lhumerus lwrist<lradius lhand<lwrist"
    " lthumb<lwrist lfingers<lhand"
    " rclavicle<thorax rhumerus<rclavicle rradius<rhumerus rwrist<rradius rhand<rwrist"
    " rthumb<rwrist rfingers<rhand",
)
NTU21 = NTU25.without(["left_hand_tip", "left_thumb", "right_hand_tip", "right_thumb"])
ALL = (NTU25, NTU21, SBU15, DUET15, EXPI18, INTERHUMAN22, DUO27, CMU22, PRIOR17, ACCLAIM)

# Which joints a left upper arm, forearm, thigh and shin lie between.
LIMBS = {
    "ntu25": "left_shoulder left_elbow left_wrist left_hip left_knee left_ankle",
    "ntu25-21": "left_shoulder left_elbow left_wrist left_hip left_knee left_ankle",
    "sbu15": "left_shoulder left_elbow left_hand left_hip left_knee left_foot",
    "duet15": "left_shoulder left_elbow left_wrist left_hip left_knee left_ankle",
    "expi18": "left_shoulder left_elbow left_wrist left_hip left_knee left_heel",
    "interhuman22": "left_shoulder left_elbow left_wrist left_hip left_knee left_ankle",
    "duo27": "LeftArm LeftForeArm LeftHand LeftUpLeg LeftLeg LeftFoot",
    "cmu22": "lshoulder lelbow lwrist lhip lknee lankle",
    "prior17": "LeftShoulder LeftHand LeftHand_end LeftHip LeftKnee LeftFoot",
    "acclaim": "lclavicle lhumerus lradius lhipjoint lfemur ltibia",
}


@pytest.mark.parametrize("skeleton", ALL, ids=lambda s: s.name)
def test_limbs_have_the_same_names_on_every_skeleton(skeleton: Skeleton) -> None:
    shoulder, elbow, wrist, hip, knee, ankle = LIMBS[skeleton.name].split()
    expected = {
        "left_upper_arm": (shoulder, elbow),
        "left_forearm": (elbow, wrist),
        "left_thigh": (hip, knee),
        "left_shin": (knee, ankle),
    }
    ends = {
        segment.name: tuple(skeleton.joints[joint] for joint in bone)
        for bone, segment in zip(skeleton.bones, segments(skeleton), strict=True)
    }
    assert {name: ends[name] for name in expected} == expected


@pytest.mark.parametrize("skeleton", ALL, ids=lambda s: s.name)
def test_every_bone_has_a_name_of_its_own_and_a_mirror_image_its_name(skeleton: Skeleton) -> None:
    named = segments(skeleton)
    assert len({segment.name for segment in named}) == len(skeleton.bones)
    for left, right in skeleton.mirrored_bones:
        assert named[left].kind == named[right].kind
        assert named[left].name.startswith("left_")
        assert named[right].name.startswith("right_")


@pytest.mark.parametrize("skeleton", ALL, ids=lambda s: s.name)
def test_the_legs_are_the_lower_body_and_all_else_the_upper(skeleton: Skeleton) -> None:
    lower = {s.kind for s in segments(skeleton) if not s.is_upper}
    assert lower >= {"hip", "thigh", "shin"}
    assert lower <= {"hip", "thigh", "shin", "foot", "toes"}
    parts = {s.kind: s.part for s in segments(skeleton)}
    assert (parts["upper_arm"], parts["thigh"], parts["hip"]) == ("arm", "leg", "trunk")


def test_a_thumb_is_no_finger_and_a_collar_no_shoulder() -> None:
    names = {s.name for s in segments(DUO27)}
    assert names >= {"left_collar", "left_shoulder", "left_hand", "left_hand_thumb1", "spine3"}
    assert {"left_thumb", "left_fingers"} <= {s.name for s in segments(NTU25)}
    assert {"left_thumb", "left_fingers", "left_fingers_2"} <= {s.name for s in segments(ACCLAIM)}


@pytest.mark.parametrize("prefix", ["", "mixamorig:", "Bob_", "Armature|mixamorig:"])
def test_segments_have_their_names_after_any_prefix_of_all_joints(prefix: str) -> None:
    skeleton, _ = mixamo(people(), prefix)
    names = {segment.name for segment in segments(skeleton)}
    assert {"left_forearm", "right_thigh", "left_shin", "spine1", "head"} <= names


def test_sides_at_the_end_of_a_name_are_mirror_images() -> None:
    joints = ("SpineBase", "HipLeft", "HipRight", "KneeLeft", "KneeRight")
    assert mirror_by_name(joints) == ((1, 2), (3, 4))
    assert mirror_by_name(("root", "lowerback", "lknee", "rknee")) == ((2, 3),)
