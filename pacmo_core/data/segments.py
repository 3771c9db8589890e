"""Names of bones by body segment, the same on every skeleton: ``left_forearm``.

The names do not depend on the names or number of joints. Limbs are identified by structure: a limb
begins at a joint with a mirror image whose parent has none. Joint names only tell arms from legs,
and where a limb bends. Bones of the trunk, and those beside a limb's main chain, are named after
the joint at which they end.
"""

import re
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.skeleton import Skeleton, bare_names, split_side

_LEG = re.compile(r"hip|thigh|leg|knee|shin|calf|ankle|heel|foot|toe|femur|tibia")
_ARM = re.compile(r"collar|clavicle|shoulder|arm|elbow|wrist|hand|humerus|radius")
# The joint at which a limb bends. A joint named after a bone is its proximal end, except for
# Acclaim's humerus and femur, which are the distal ends.
_BENDS = {
    "arm": re.compile(r"elbow|fore_?arm|low(er)?_?arm|humerus"),
    "leg": re.compile(r"knee|(?<!up)(?<!up_)(?<!upper)leg|shin|calf|femur"),
}
_DIGIT = re.compile(r"thumb|finger|index|ring|pinky|middle")
# Segments of a limb, from the one before the upper arm or thigh outwards.
_SEGMENTS = {
    "arm": ("shoulder", "upper_arm", "forearm", "hand", "fingers"),
    "leg": ("hip", "thigh", "shin", "foot", "toes"),
}
_PROXIMAL = {"arm": "collar", "leg": "pelvis"}
UPRIGHT_SHARE = 0.25  # of frames
_UPPER_SEGMENT = 1  # index of the upper arm and the thigh


@dataclass(frozen=True)
class Segment:
    """A body segment.

    Parameters
    ----------
    name : unique on its skeleton, such as ``left_forearm``
    part : ``arm``, ``leg``, ``foot`` or ``trunk``; the shoulder and the hip belong to the trunk
    is_upper : whether it is above the hips
    """

    name: str
    part: str
    is_upper: bool

    @property
    def kind(self) -> str:
        """The name without left or right."""
        return self.name.removeprefix("left_").removeprefix("right_")


@lru_cache(maxsize=8)
def segments(skeleton: Skeleton) -> tuple[Segment, ...]:
    """Return the segment of every bone, in the order of ``skeleton.bones``."""
    limbs: dict[int, Segment] = {}
    for limb_root, side in _limb_roots(skeleton):
        limbs |= _name_limb(skeleton, limb_root, side)
    used = {segment.name for segment in limbs.values()}
    names = bare_names(skeleton.joints)
    result = []
    for child in skeleton.bones[:, 1].tolist():
        name = snake_case(names[child])
        segment = limbs.get(child) or Segment(name, "trunk", is_upper=True)
        if child not in limbs and segment.name in used:
            segment = Segment(f"{segment.name}_{child}", "trunk", is_upper=True)
        used.add(segment.name)
        result.append(segment)
    return tuple(result)


@lru_cache(maxsize=8)
def feet(skeleton: Skeleton) -> tuple[tuple[int, ...], ...]:
    """List the joints of each foot: the end of the shin, then those beyond it; none if unnamed."""
    children = skeleton.bones[:, 1].tolist()
    kinds = dict(zip(children, segments(skeleton), strict=True))
    ankles = [joint for joint in children if kinds[joint].kind == "shin"]
    return tuple(
        (ankle, *(j for j in _descendants(skeleton, ankle)[1:] if kinds[j].part == "foot"))
        for ankle in ankles
    )


def shoulders(skeleton: Skeleton) -> tuple[int, ...]:
    """List the joints at which upper arms begin; none if no arm has a name."""
    return _first_joints(skeleton, "upper_arm")


def trunk_pairs(skeleton: Skeleton) -> list[tuple[int, int]]:
    """List the left and right joints at which limbs begin, hips and shoulders."""
    limbs = {*_first_joints(skeleton, "thigh"), *shoulders(skeleton)}
    return [pair for pair in skeleton.left_right if set(pair) <= limbs]


def _first_joints(skeleton: Skeleton, kind: str) -> tuple[int, ...]:
    """List the joints at which segments of a kind begin."""
    children = zip(skeleton.bones[:, 1].tolist(), segments(skeleton), strict=True)
    return tuple(skeleton.parents[child] for child, segment in children if segment.kind == kind)


def snake_case(joint: str) -> str:
    """Convert a joint's name to snake case, such as ``left_hand_thumb1``."""
    words = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", joint)
    return re.sub(r"\W+", "_", words).lower()


def _limb_roots(skeleton: Skeleton) -> list[tuple[int, str]]:
    """List the first joint and the side of each limb."""
    side = {left: "left" for left, _ in skeleton.left_right}
    side |= {right: "right" for _, right in skeleton.left_right}
    return [(j, side[j]) for j in skeleton.order if j in side and skeleton.parents[j] not in side]


def _name_limb(skeleton: Skeleton, limb_root: int, side: str) -> dict[int, Segment]:
    """Return the segments that end at a limb's joints, by joint."""
    joints = _descendants(skeleton, limb_root)
    words = " ".join(bare_names(skeleton.joints)[joint].lower() for joint in joints)
    kind = "leg" if _LEG.search(words) else "arm" if _ARM.search(words) else ""
    if not kind or limb_root == skeleton.root:
        return {}
    chain = _main_chain(skeleton, limb_root)
    bare = bare_names(skeleton.joints)
    names = [bare[joint].lower() for joint in chain]
    bend = next((i for i, name in enumerate(names) if _BENDS[kind].search(name)), 1)
    limb = {}
    for joint in joints:
        index = chain.index(joint) - bend + _UPPER_SEGMENT if joint in chain else None
        name = _segment_name(bare[joint], side, kind, index)
        limb[joint] = Segment(name, _body_part(kind, index), is_upper=kind == "arm")
    return limb


def _segment_name(joint: str, side: str, kind: str, index: int | None) -> str:
    """Return a segment's name from its index in ``_SEGMENTS``; None for one beside the chain."""
    names = _SEGMENTS[kind]
    if index is None:
        bare = snake_case(split_side(joint)[1]).strip("_")
        return f"{side}_{re.sub(r'^(left|right|rght|l(?!eg)|r)_?', '', bare)}"
    if index < 0:
        return f"{side}_{_PROXIMAL[kind]}" + (f"_{-index}" if index < -1 else "")
    excess = index - len(names) + 1
    return f"{side}_{names[min(index, len(names) - 1)]}" + (f"_{excess + 1}" if excess > 0 else "")


def _body_part(kind: str, index: int | None) -> str:
    if index is not None and index < _UPPER_SEGMENT:
        return "trunk"
    is_foot = kind == "leg" and (index is None or index > _SEGMENTS["leg"].index("shin"))
    return "foot" if is_foot else kind


def _descendants(skeleton: Skeleton, joint: int) -> list[int]:
    """List a joint and all joints below it."""
    joints = [joint]
    for parent in joints:
        joints.extend(i for i, p in enumerate(skeleton.parents) if p == parent)
    return joints


def _main_chain(skeleton: Skeleton, joint: int) -> list[int]:
    """Return the longest chain of joints to the end of a limb, past its digits if possible."""
    children = [i for i, parent in enumerate(skeleton.parents) if parent == joint]
    if not children:
        return [joint]
    chains = [_main_chain(skeleton, child) for child in children]
    is_digit = [bool(_DIGIT.search(skeleton.joints[child].lower())) for child in children]
    best = min(range(len(chains)), key=lambda i: (is_digit[i], -len(chains[i])))
    return [joint, *chains[best]]


def upright_frames(motion: NDArray[np.floating], skeleton: Skeleton) -> NDArray[np.bool_]:
    """Return in which frames of ``(T, J, 3)`` the trunk is as long as in the straightest quarter.

    A bone of the skeleton may pass by joints of the capture: bent over, it is shorter.
    """
    ends = zip(skeleton.bones[:, 1].tolist(), segments(skeleton), strict=True)
    trunk = [end for end, segment in ends if segment.part == "trunk"] or [skeleton.root]
    reach = np.linalg.norm(motion[:, trunk] - motion[:, [skeleton.root]], axis=-1).max(axis=1)
    return np.asarray(reach >= np.quantile(reach, 1 - UPRIGHT_SHARE))
