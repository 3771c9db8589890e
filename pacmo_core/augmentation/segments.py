"""What the bones of a body are called: a forearm is one on every skeleton.

A bone is named after the part of the body that it is, ``left_forearm``, whatever its joints are
called and however many there are. Limbs are found by shape: what hangs on a joint that has a mirror
image, where its parent has none; names only say whether one is an arm and where it bends.
Bones of the middle, and those beside a limb's chain, have the name of the joint at which they end.
"""

import re
from dataclasses import dataclass
from functools import lru_cache

from pacmo_core.data.skeleton import Skeleton

_LEG = re.compile(r"hip|thigh|leg|knee|shin|calf|ankle|heel|foot|toe|femur|tibia")
_ARM = re.compile(r"collar|clavicle|shoulder|arm|elbow|wrist|hand|humerus|radius")
# Where a limb bends. A joint that bears a bone's name is its near end, but for Acclaim's humerus
# and femur, which are the far ends.
_BENDS = {
    "arm": re.compile(r"elbow|fore_?arm|low(er)?_?arm|humerus"),
    "leg": re.compile(r"knee|(?<!up)(?<!up_)(?<!upper)leg|shin|calf|femur"),
}
_DIGIT = re.compile(r"thumb|finger|index|ring|pinky|middle")
# From the joint before the bend outwards; before it all is collar.
_CHAIN = {
    "arm": ("shoulder", "upper_arm", "forearm", "hand", "fingers"),
    "leg": ("hip", "thigh", "shin", "foot", "toes"),
}
_BEFORE = {"arm": "collar", "leg": "pelvis"}
_SHOULDER_AND_HIP = 1


@dataclass(frozen=True)
class Segment:
    """A bone by what it is.

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
        """Give the name without its side."""
        return self.name.removeprefix("left_").removeprefix("right_")


@lru_cache(maxsize=8)
def segments(skeleton: Skeleton) -> tuple[Segment, ...]:
    """Name every bone, in the order of ``skeleton.bones``."""
    found: dict[int, Segment] = {}
    for limb_root, side in _limb_roots(skeleton):
        found |= _name_limb(skeleton, limb_root, side)
    taken = {segment.name for segment in found.values()}
    named = []
    for child in skeleton.bones[:, 1].tolist():
        segment = found.get(child) or Segment(
            snake_case(skeleton.joints[child]), "trunk", is_upper=True
        )
        if child not in found and segment.name in taken:
            segment = Segment(f"{segment.name}_{child}", "trunk", is_upper=True)
        taken.add(segment.name)
        named.append(segment)
    return tuple(named)


def snake_case(joint: str) -> str:
    """Write a joint's name as ``left_hand_thumb1``, whatever the data set's fashion."""
    words = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", joint)
    return re.sub(r"\W+", "_", words).lower()


def _limb_roots(skeleton: Skeleton) -> list[tuple[int, str]]:
    side = {left: "left" for left, _ in skeleton.left_right}
    side |= {right: "right" for _, right in skeleton.left_right}
    return [(j, side[j]) for j in skeleton.order if j in side and skeleton.parents[j] not in side]


def _name_limb(skeleton: Skeleton, limb_root: int, side: str) -> dict[int, Segment]:
    """Name the bones that end at a limb's joints."""
    below = _descendants(skeleton, limb_root)
    words = " ".join(skeleton.joints[joint].lower() for joint in below)
    kind = "leg" if _LEG.search(words) else "arm" if _ARM.search(words) else ""
    if not kind or limb_root == skeleton.root:
        return {}
    chain = _main_chain(skeleton, limb_root)
    names = [skeleton.joints[joint].lower() for joint in chain]
    bend = next((i for i, name in enumerate(names) if _BENDS[kind].search(name)), 1)
    found = {}
    for joint in below:
        place = chain.index(joint) - bend + _SHOULDER_AND_HIP if joint in chain else None
        name = _segment_name(skeleton.joints[joint], side, kind, place)
        found[joint] = Segment(name, _body_part(kind, place), is_upper=kind == "arm")
    return found


def _segment_name(joint: str, side: str, kind: str, place: int | None) -> str:
    words = _CHAIN[kind]
    if place is None:
        bare = re.sub(r"^(left|right|rght|l(?!eg)|r)_?", "", snake_case(joint))
        return f"{side}_{bare}"
    if place < 0:
        return f"{side}_{_BEFORE[kind]}" + (f"_{-place}" if place < -1 else "")
    beyond = place - len(words) + 1
    return f"{side}_{words[min(place, len(words) - 1)]}" + (f"_{beyond + 1}" if beyond > 0 else "")


def _body_part(kind: str, place: int | None) -> str:
    if place is not None and place < _SHOULDER_AND_HIP:
        return "trunk"
    is_foot = kind == "leg" and (place is None or place > _CHAIN["leg"].index("shin"))
    return "foot" if is_foot else kind


def _descendants(skeleton: Skeleton, joint: int) -> list[int]:
    below = [joint]
    for parent in below:
        below.extend(i for i, p in enumerate(skeleton.parents) if p == parent)
    return below


def _main_chain(skeleton: Skeleton, joint: int) -> list[int]:
    """Follow a limb to its end, past its digits where there is another way."""
    children = [i for i, parent in enumerate(skeleton.parents) if parent == joint]
    if not children:
        return [joint]
    ways = [_main_chain(skeleton, child) for child in children]
    digits = [bool(_DIGIT.search(skeleton.joints[child].lower())) for child in children]
    best = min(range(len(ways)), key=lambda way: (digits[way], -len(ways[way])))
    return [joint, *ways[best]]
