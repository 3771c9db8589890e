"""Rigs: how the skeletons of common programs and datasets name the points of a body.

A point of a body (``left_shoulder``, the joint between trunk and upper arm) has one name here, and
another in each rig. A rig is a text of words ``point=JOINT``; sided points are written once.

- ``point=A+B``: the rig has no such joint; it is the mid-point of A and B.
- ``point=A~``: no such joint either; A is near it, and taken for it where nothing better is named.
- ``point=A?``: files of this rig may lack A; of several words for a point the first applies whose
  joints a file has.

Names are compared as ``plain_name`` writes them: ``L_Hip``, ``left_hip`` and ``HipLeft`` are
equal. The joints of SMPL: Loper et al. (2015); of Mixamo, OptiTrack (Motive) and ZED (BODY_34): the
programs' documentation; of CMU: the database's ASF files, in which a joint is the far end of its
bone; of the Kinects: as NTU RGB+D and SBU publish them (``data.skeleton``); of Unreal's mannequins,
3ds Max's Biped, Blender's human metarig, Unity's humanoid and Xsens MVN: as these programs export
them. Biovision's are those of the files that the format was published with.
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby

from pacmo_core.data.skeleton import bare_names, split_side

SIDES = ("left", "right")

# Points that are defined by others on every body. NITE, which tracks for the first Kinect, computes
# its neck and torso so; Kinect v2's spine at the shoulders is there by name.
DEFINITIONS = {
    "shoulder_centre": ("left_shoulder", "right_shoulder"),
    "hip_centre": ("left_hip", "right_hip"),
    "torso_centre": ("left_shoulder", "right_shoulder", "left_hip", "right_hip"),
}
# Points that a capture may lack, as weighted means of others on an average body. Toes are put ahead
# of the ankle by ``JointNames``: no mean is there.
ESTIMATES = {
    "pelvis": {"left_hip": 0.5, "right_hip": 0.5},
    "spine_mid": {"left_hip": 0.2, "right_hip": 0.2, "left_shoulder": 0.3, "right_shoulder": 0.3},
    "neck": {"left_shoulder": 0.3, "right_shoulder": 0.3, "head": 0.4},
    **{f"{side}_wrist": {f"{side}_elbow": 0.18, f"{side}_hand": 0.82} for side in SIDES},
    **{
        f"{side}_ankle": {f"{side}_heel": 0.75, f"{side}_toe": 0.15, f"{side}_knee": 0.1}
        for side in SIDES
    },
    **{f"{side}_toe": {f"{side}_ankle": 1.0} for side in SIDES},
}


@dataclass(frozen=True)
class Place:
    """Where a rig has a point.

    Parameters
    ----------
    joints : plain names; of several the mean of their positions
    is_near : whether it is not the point itself, but near it
    is_optional : whether files of the rig may lack the joints
    """

    joints: tuple[str, ...]
    is_near: bool = False
    is_optional: bool = False


@dataclass(frozen=True)
class Rig:
    """The names of one rig.

    Parameters
    ----------
    name : of the preset
    places : of each point, the best first
    """

    name: str
    places: dict[str, tuple[Place, ...]]

    @property
    def required(self) -> frozenset[str]:
        """The joints that every file of this rig has, by plain name."""
        places = [place for several in self.places.values() for place in several]
        return frozenset(j for place in places if not place.is_optional for j in place.joints)

    def place_of(self, point: str, joints: Iterable[str]) -> Place | None:
        """Return where a file with these joints has a point; None if it is not named."""
        present = set(joints)
        for place in self.places.get(point, ()):
            if present.issuperset(place.joints):
                return place
        places = [self.place_of(part, present) for part in DEFINITIONS.get(point, ())]
        if not places or any(place is None or len(place.joints) > 1 for place in places):
            return None
        return Place(tuple(place.joints[0] for place in places if place))

    def estimate_of(self, point: str, joints: Iterable[str]) -> dict[str, float]:
        """Return the shares of a file's joints in a point that it lacks; empty if unknown."""
        present = set(joints)
        found: dict[str, float] = {}
        for part, share in ESTIMATES.get(point, {}).items():
            place = self.place_of(part, present)
            if place is None:
                return {}
            found |= {joint: share / len(place.joints) for joint in place.joints}
        return found

    def points_of(self, joint: str) -> list[str]:
        """List the points that a joint of this plain name is, itself."""
        return [
            point
            for point, places in self.places.items()
            if any(place.joints == (joint,) and not place.is_near for place in places)
        ]


def plain_names(joints: Sequence[str]) -> list[str]:
    """Write the names of one body's joints in one way; what all of them begin with is left out."""
    return [plain_name(joint) for joint in bare_names(joints)]


def plain_name(joint: str) -> str:
    """Write ``mixamorig:LeftUpLeg`` as ``leftupleg``, ``L_Hip`` and ``HipLeft`` as ``lefthip``.

    And ``upper_arm.L`` and ``Bip01 L UpperArm`` as ``leftupperarm``.
    """
    name = re.sub(r"^(valvebiped\.)?bip\d+[ _]", "", joint.rpartition(":")[2], flags=re.IGNORECASE)
    name = re.sub(r"[^a-z0-9]", "", "".join(split_side(name)).lower())
    side = re.fullmatch(r"(.+)(left|right)", name)
    return f"{side[2]}{side[1]}" if side else name


def _rig(name: str, centre: str, sided: str, left: str = "left_", right: str = "right_") -> Rig:
    """Build a rig: the points of the middle, and those of both sides with their prefixes."""
    places = {point: _places(words, "") for point, words in _by_point(centre)}
    for side, prefix in zip(SIDES, (left, right), strict=True):
        places |= {f"{side}_{point}": _places(ws, prefix) for point, ws in _by_point(sided)}
    return Rig(name, places)


def _by_point(text: str) -> Iterable[tuple[str, list[str]]]:
    words = [word.partition("=") for word in text.split()]
    for point, group in groupby(words, key=lambda word: word[0]):
        yield point, [joints for _, _, joints in group]


def _places(words: list[str], prefix: str) -> tuple[Place, ...]:
    return tuple(
        Place(
            tuple(plain_name(prefix + joint) for joint in word.rstrip("?~").split("+")),
            is_near="~" in word,
            is_optional="?" in word,
        )
        for word in words
    )


_MIXAMO_SIDES = (
    "hip=UpLeg knee=Leg ankle=Foot toe=ToeBase toe_end=Toe_End? collar=Shoulder shoulder=Arm"
    " elbow=ForeArm wrist=Hand hand=Hand+HandMiddle1? hand=Hand+HandIndex1? hand=Hand~"
    " knuckles=HandMiddle1? fingers=HandMiddle4? thumb_base=HandThumb1? thumb=HandThumb4?"
)
_UNREAL_SIDES = (
    "hip=thigh knee=calf ankle=foot toe=ball collar=clavicle shoulder=upperarm elbow=lowerarm"
    " wrist=hand hand=hand+middle_01? hand=hand~ knuckles=middle_01? fingers=middle_03?"
    " thumb_base=thumb_01? thumb=thumb_03?"
)
_UNITY_SIDES = (
    "hip=UpperLeg knee=LowerLeg ankle=Foot toe=Toes collar=Shoulder shoulder=UpperArm"
    " elbow=LowerArm wrist=Hand hand=Hand+MiddleProximal? hand=Hand~"
    " knuckles=MiddleProximal? thumb_base=ThumbProximal?"
)
_BIOVISION_SIDES = (
    "hip=Hip knee=Knee ankle=Ankle collar=Collar shoulder=Shoulder elbow=Elbow wrist=Wrist"
    " hand=Wrist~"
)
_ROWS = (
    _rig(
        "smpl",
        "pelvis=pelvis spine_low=spine1 spine_mid=spine2 spine_high=spine3 neck=neck head=head",
        "hip=hip knee=knee ankle=ankle toe=foot collar=collar shoulder=shoulder elbow=elbow"
        " wrist=wrist hand=hand? hand=wrist~",
    ),
    _rig(
        "mixamo",
        "pelvis=Hips spine_low=Spine spine_mid=Spine1 spine_high=Spine2 neck=Neck head=Head"
        " head_top=HeadTop_End?",
        _MIXAMO_SIDES,
        "Left",
        "Right",
    ),
    _rig(
        "duo_mocap",
        "pelvis=Hips spine_low=Spine spine_low_2=Spine1 spine_mid=Spine2 spine_high=Spine3"
        " neck=Neck head=Head",
        "hip=UpLeg knee=Leg ankle=Foot toe=ToeBase collar=Shoulder shoulder=Arm elbow=ForeArm"
        " wrist=Hand hand=Hand+HandEnd knuckles=HandEnd thumb_base=HandThumb1",
        "Left",
        "Right",
    ),
    _rig(
        "cmu",
        "pelvis=root? pelvis=hip? spine_low=lowerback spine_mid=upperback spine_high=thorax"
        " neck=lowerneck head=upperneck head_top=head",
        "hip=hipjoint knee=femur ankle=tibia toe=foot toe_end=toes shoulder=clavicle"
        " elbow=humerus wrist=radius hand=radius+wrist knuckles=wrist finger_base=hand"
        " fingers=fingers thumb=thumb",
        "l",
        "r",
    ),
    # BVH files that name a joint by the bone of CMU that begins there. By names alone they are not
    # told from those of ``cmu``: a user says so, and no joint is required. Converters lose bones
    # beside others that begin at the same joint, such as the one to the hand: fingers have a place.
    _rig(
        "cmu_bones",
        "pelvis=root? pelvis=hip? spine_low=upperback? spine_mid=thorax? spine_high=lowerneck?"
        " neck=upperneck? head=head?",
        "hip=femur? knee=tibia? ankle=foot? toe=toes? shoulder=humerus? elbow=radius? wrist=wrist?"
        " hand=wrist+fingers? knuckles=hand? finger_base=fingers?",
        "l",
        "r",
    ),
    _rig(
        "cmu_bvh",
        "pelvis=Hips spine_low=Spine spine_mid=Spine1 spine_high=Neck neck=Neck1 head=Head",
        "hip=UpLeg knee=Leg ankle=Foot toe=ToeBase collar=Shoulder shoulder=Arm elbow=ForeArm"
        " wrist=Hand hand=Hand+FingerBase knuckles=FingerBase fingers=HandIndex1?",
        "Left",
        "Right",
    ),
    _rig(
        "cmu_18_19",
        "pelvis=root spine_low=lowerback spine_mid=upperback spine_high=chest neck=lowerneck"
        " head=upperneck",
        "hip=hip knee=knee ankle=ankle toe=toe collar=clavicle shoulder=shoulder elbow=elbow"
        " wrist=wrist hand=wrist~",
        "l",
        "r",
    ),
    _rig(
        "optitrack",
        "pelvis=Hip spine_low=Ab spine_mid=Ab+Chest spine_high=Chest neck=Neck head=Head",
        "hip=Thigh knee=Shin ankle=Foot toe=Toe collar=Shoulder shoulder=UArm elbow=FArm"
        " wrist=Hand hand=Hand+Middle1? hand=Hand~",
        "L",
        "R",
    ),
    _rig(
        "optitrack_bvh",
        "pelvis=Hips spine_low=Spine spine_mid=Spine+Spine1 spine_high=Spine1 neck=Neck head=Head",
        _MIXAMO_SIDES,
        "Left",
        "Right",
    ),
    _rig(
        "unreal",
        "pelvis=pelvis spine_low=spine_01 spine_mid=spine_02 spine_high=spine_03 neck=neck_01"
        " head=head",
        _UNREAL_SIDES,
    ),
    _rig(
        "unreal5",
        "pelvis=pelvis spine_low=spine_01 spine_low_2=spine_02 spine_mid=spine_03"
        " spine_high=spine_04 spine_high_2=spine_05 neck=neck_01 neck_high=neck_02 head=head",
        _UNREAL_SIDES,
    ),
    _rig(
        "biped",
        "pelvis=Pelvis spine_low=Spine spine_mid=Spine1 spine_high=Spine2? neck=Neck head=Head",
        "hip=Thigh knee=Calf ankle=Foot toe=Toe0 collar=Clavicle shoulder=UpperArm elbow=Forearm"
        " wrist=Hand hand=Hand+Finger2? hand=Hand~ knuckles=Finger2? thumb_base=Finger0?",
    ),
    _rig(
        "blender",
        "pelvis=spine spine_low=spine.001 spine_mid=spine.002 spine_high=spine.003 neck=spine.004"
        " neck_high=spine.005 head=spine.006",
        "hip=thigh knee=shin ankle=foot toe=toe collar=shoulder shoulder=upper_arm elbow=forearm"
        " wrist=hand hand=hand+f_middle.01? hand=hand~ knuckles=f_middle.01? thumb_base=thumb.01?",
    ),
    _rig(
        "unity",
        "pelvis=Hips spine_low=Spine spine_mid=Spine+Chest spine_high=Chest neck=Neck head=Head",
        _UNITY_SIDES,
    ),
    _rig(
        "unity_upper_chest",
        "pelvis=Hips spine_low=Spine spine_mid=Chest spine_high=UpperChest neck=Neck head=Head",
        _UNITY_SIDES,
    ),
    _rig(
        "biovision",
        "pelvis=Hips spine_mid=Chest~ neck=Neck head=Head",
        f"{_BIOVISION_SIDES} toe=Toe?",
    ),
    _rig(
        "biovision_bones",
        "pelvis=Hips spine_mid=Chest~ neck=Neck head=Head",
        "hip=UpLeg knee=LowLeg ankle=Foot toe=Toe? collar=Collar shoulder=UpArm elbow=LowArm"
        " wrist=Hand hand=Hand~",
    ),
    _rig(
        "xsens",
        "pelvis=Hips spine_low=Chest spine_low_2=Chest2 spine_mid=Chest3 spine_high=Chest4"
        " neck=Neck head=Head",
        f"{_BIOVISION_SIDES} toe=Toe",
    ),
    _rig(
        "zed34",
        "pelvis=pelvis spine_low=naval_spine spine_mid=naval_spine+chest_spine"
        " spine_high=chest_spine neck=neck head=head nose=nose",
        "hip=hip knee=knee ankle=ankle toe=foot heel=heel collar=clavicle shoulder=shoulder"
        " elbow=elbow wrist=wrist hand=hand fingers=hand_tip thumb=thumb eye=eye ear=ear",
    ),
    _rig(
        "kinect25",
        "pelvis=spine_base spine_mid=spine_mid shoulder_centre=spine_shoulder neck=neck head=head",
        "hip=hip knee=knee ankle=ankle toe=foot shoulder=shoulder elbow=elbow wrist=wrist hand=hand"
        " fingers=hand_tip? thumb=thumb?",
    ),
    _rig(
        "kinect15",
        "torso_centre=torso shoulder_centre=neck head=head",
        "hip=hip knee=knee ankle=foot shoulder=shoulder elbow=elbow hand=hand",
    ),
    _rig(
        "duetdance",
        "hip_centre=pelvis shoulder_centre=neck head=head",
        "hip=hip knee=knee ankle=ankle shoulder=shoulder elbow=elbow wrist=wrist hand=wrist~",
    ),
    _rig(
        "expi",
        "head=left_head+right_head",
        "hip=hip knee=knee heel=heel toe=toe shoulder=shoulder elbow=elbow wrist=wrist hand=wrist~",
    ),
)
RIGS = {rig.name: rig for rig in _ROWS}


def fitting_rigs(joints: Iterable[str]) -> list[Rig]:
    """List the rigs whose required joints a file has, by plain name.

    A rig whose joints are some of another's is left out: the file has more than it names.
    """
    present = set(joints)
    fitting = [rig for rig in RIGS.values() if rig.required and rig.required <= present]
    return [rig for rig in fitting if not any(rig.required < other.required for other in fitting)]


def contained_rigs(rig: Rig, joints: Iterable[str]) -> list[str]:
    """Name the rigs that fit a file too, but whose joints are some of this rig's."""
    present = set(joints)
    return [r.name for r in RIGS.values() if r.required <= present and r.required < rig.required]


def rig_of_model(joints: Sequence[str]) -> Rig | None:
    """Return the smallest rig that has a point for each of a model's joints; None without one."""
    rigs = [
        rig
        for rig in RIGS.values()
        if rig.required and all(rig.points_of(joint) for joint in joints)
    ]
    return min(rigs, key=lambda rig: len(rig.required), default=None)
