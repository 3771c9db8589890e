"""Skeletons: trees of named joints, and the published skeletons of the datasets.

Joints keep the order of their dataset, so that joint indices in the literature are valid here; a
parent may therefore come after its child, and ``Skeleton.order`` lists parents first.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.limits import MAX_JOINTS

OBJECT = "object"  # a joint of this name is a thing that somebody holds, and no part of a body


@dataclass(frozen=True)
class Skeleton:
    """Named joints, the parent of each, and which are mirror images.

    Parameters
    ----------
    name : str
    joints : unique names
    parents : index of each joint's parent, -1 for the one root
    left_right : pairs (left joint, right joint) of mirror images

    Raises
    ------
    ValueError
        If the parents do not form one tree over the joints, or a name or index is wrong.
    """

    name: str
    joints: tuple[str, ...]
    parents: tuple[int, ...]
    left_right: tuple[tuple[int, int], ...] = ()

    def __post_init__(self) -> None:
        if len(set(self.joints)) != len(self.joints) or len(self.parents) != len(self.joints):
            raise ValueError(
                f"skeleton {self.name}: wanted one parent per joint and unique names; "
                f"got {len(self.joints)} joints ({len(set(self.joints))} names), "
                f"{len(self.parents)} parents"
            )
        if self.parents.count(-1) != 1 or len(self.order) != len(self.joints):
            raise ValueError(
                f"skeleton {self.name}: parents must form one tree; got {self.parents}"
            )
        outside = [i for pair in self.left_right for i in pair if not 0 <= i < len(self.joints)]
        if outside:
            raise ValueError(f"skeleton {self.name}: left_right names joints {outside}")

    @classmethod
    def from_dict(cls, fields: Mapping[str, Any]) -> "Skeleton":
        """Build a skeleton from the fields of ``to_dict``, read from JSON or not.

        Raises
        ------
        KeyError, TypeError, ValueError
            If a field is missing or is not a skeleton's.
        """
        _check_types(fields)
        return cls(
            name=fields["name"],
            joints=tuple(fields["joints"]),
            parents=tuple(fields["parents"]),
            left_right=tuple((left, right) for left, right in fields["left_right"]),
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the four fields by name, which JSON can represent."""
        return {
            "name": self.name,
            "joints": self.joints,
            "parents": self.parents,
            "left_right": self.left_right,
        }

    @property
    def root(self) -> int:
        """The joint without a parent."""
        return self.parents.index(-1)

    @property
    def end_effectors(self) -> tuple[int, ...]:
        """The joints without children: head, hands and feet."""
        inner = set(self.parents)
        return tuple(joint for joint in range(len(self.joints)) if joint not in inner)

    @cached_property
    def order(self) -> tuple[int, ...]:
        """The joints reached from the root, every parent before its children."""
        order = [i for i, parent in enumerate(self.parents) if parent == -1][:1]
        for joint in order:
            order.extend(i for i, parent in enumerate(self.parents) if parent == joint)
        return tuple(order)

    @property
    def bones(self) -> NDArray[np.intp]:
        """``(E, 2)`` rows (parent, child), in the order of the children."""
        pairs = [(parent, child) for child, parent in enumerate(self.parents) if parent >= 0]
        return np.array(pairs, dtype=np.intp).reshape(-1, 2)

    @property
    def body_bones(self) -> NDArray[np.intp]:
        """Rows of ``bones`` without that to ``OBJECT``, which is no part of a body."""
        rows = [bone for bone in self.bones.tolist() if self.joints[bone[1]] != OBJECT]
        return np.array(rows, dtype=np.intp).reshape(-1, 2)

    @property
    def mirrored_bones(self) -> NDArray[np.intp]:
        """``(S, 2)`` pairs of rows of ``bones`` that are mirror images of each other."""
        rows = {tuple(bone): row for row, bone in enumerate(self.bones.tolist())}
        mirror = dict(self.left_right)
        pairs = [
            (rows[parent, left], rows[mirror.get(parent, parent), right])
            for left, right in self.left_right
            for parent in [self.parents[left]]
            if (mirror.get(parent, parent), right) in rows
        ]
        return np.array(pairs, dtype=np.intp).reshape(-1, 2)

    def without(self, names: Iterable[str]) -> "Skeleton":
        """Remove joints; their children become children of the nearest remaining ancestor.

        Raises
        ------
        ValueError
            If a name is not a joint's, or is the root's.
        """
        removed = set(names)
        unknown = removed - set(self.joints)
        if unknown or self.joints[self.root] in removed:
            raise ValueError(
                f"skeleton {self.name}: cannot remove {sorted(unknown) or 'the root'}; "
                f"its joints are {', '.join(self.joints)}"
            )
        if not removed:
            return self
        remaining = [i for i, joint in enumerate(self.joints) if joint not in removed]
        new = {old: i for i, old in enumerate(remaining)}
        return Skeleton(
            name=f"{self.name}-{len(remaining)}",
            joints=tuple(self.joints[i] for i in remaining),
            parents=tuple(new.get(self._remaining_parent(i, removed), -1) for i in remaining),
            left_right=tuple(
                (new[a], new[b]) for a, b in self.left_right if {a, b} <= set(remaining)
            ),
        )

    def ancestors(self, joint: int) -> list[int]:
        """List the joints from the parent of a joint to the root."""
        above = []
        while (joint := self.parents[joint]) >= 0:
            above.append(joint)
        return above

    def indices(self, names: Iterable[str]) -> list[int]:
        """List the indices of joints by name."""
        return [self.joints.index(name) for name in names]

    def _remaining_parent(self, joint: int, removed: set[str]) -> int:
        parent = self.parents[joint]
        while parent >= 0 and self.joints[parent] in removed:
            parent = self.parents[parent]
        return parent


def skeleton_difference(found: Skeleton, known: Skeleton, whose: str) -> str:
    """Say in a message's words how a skeleton differs from another; empty if it does not.

    Parameters
    ----------
    whose : what has the known one, such as ``the captures have``
    """
    if found == known:
        return ""
    lacking = [joint for joint in known.joints if joint not in found.joints]
    more = [joint for joint in found.joints if joint not in known.joints]
    if lacking or more:
        parts = (("without", lacking), ("with", more))
        how = " and ".join(f"{word} {', '.join(names[:3])}" for word, names in parts if names)
    elif found.joints != known.joints:
        how = "in another order"
    else:
        how = "with other parents" if found.parents != known.parents else "of another name"
    return (
        f"{len(found.joints)} joints ({found.name}) {how}, where {whose} {len(known.joints)} "
        f"({known.name})"
    )


def _check_types(fields: Mapping[str, Any]) -> None:
    """Raise ValueError unless names are texts and indices whole numbers, of a body's joints."""
    indices = (*fields["parents"], *(i for pair in fields["left_right"] for i in pair))
    wrong: list[object] = [x for x in (fields["name"], *fields["joints"]) if type(x) is not str]
    wrong += [index for index in indices if type(index) is not int]
    if wrong:
        raise ValueError(f"wanted names as text and whole numbers as indices; got {wrong[0]!r:.40}")
    if not 1 <= len(fields["joints"]) <= MAX_JOINTS:
        raise ValueError(f"wanted 1 to {MAX_JOINTS} joints; got {len(fields['joints'])}")


# A word of a name that is a side.
_SIDE = re.compile(r"(?<![^_ .-])(left|right|l|r)(?![^_ .-])", re.IGNORECASE)


def bare_names(joints: Sequence[str]) -> list[str]:
    """Leave out what programs write before the name of every joint, such as ``mixamorig:``."""
    prefix = re.match(r".*[:|_]", joints[0]) if len(joints) > 1 else None
    while prefix and not all(joint.startswith(prefix[0]) for joint in joints):
        prefix = re.match(r".*[:|_]", prefix[0][:-1])
    if prefix is None or prefix[0].lower() in ("left_", "right_", "l_", "r_"):
        return list(joints)
    return [joint[prefix.end() :] or joint for joint in joints]


def split_side(joint: str) -> tuple[str, str]:
    """Split off a side that is a word of its own: ``upperarm_l``, ``Bip01 L Thigh``, ``L_Hip``.

    Returns
    -------
    ``left``, ``right`` or nothing, and the name without it
    """
    found = _SIDE.search(joint)
    rest = joint[: found.start()] + joint[found.end() :] if found else ""
    if not found or not re.search(r"[^\W_]", rest):
        return "", joint
    return "left" if found[0].lower().startswith("l") else "right", rest


def mirror_by_name(joints: tuple[str, ...]) -> tuple[tuple[int, int], ...]:
    """Pair joints whose names differ in left and right alone.

    As in ``left_knee``, ``LeftLeg``, ``lknee`` and ``KneeLeft``, after a prefix of all joints, and
    in ``knee_l``, ``knee.L`` and ``Bip01 L Calf``.
    """
    lower = [name.lower() for name in bare_names(joints)]
    words = [split_side(name) for name in lower]
    pairs = []
    for i, name in enumerate(lower):
        mirrors = [
            right + name.removeprefix(left)
            for left, right in (("left", "right"), ("l", "r"))
            if name.startswith(left)
        ]
        if name.endswith("left"):
            mirrors.append(name.removesuffix("left") + "right")
        mirror = next((mirror for mirror in mirrors if mirror in lower), None)
        if mirror is not None:
            pairs.append((i, lower.index(mirror)))
        elif words[i][0] == "left" and ("right", words[i][1]) in words:
            pairs.append((i, words.index(("right", words[i][1]))))
    return tuple(pairs)


def _published(name: str, tree: str) -> Skeleton:
    """Build a skeleton from words ``joint<parent`` in the dataset's order; the root has none."""
    words = [word.partition("<") for word in tree.split()]
    joints = tuple(joint for joint, _, _ in words)
    parents = tuple(joints.index(parent) if parent else -1 for _, _, parent in words)
    return Skeleton(name, joints, parents, mirror_by_name(joints))


# Kinect v2, as NTU RGB+D publishes it (Shahroudy et al. 2016, fig. 1), 0-based.
NTU25 = _published(
    "ntu25",
    "spine_base spine_mid<spine_base neck<spine_shoulder head<neck"
    " left_shoulder<spine_shoulder left_elbow<left_shoulder left_wrist<left_elbow"
    " left_hand<left_wrist"
    " right_shoulder<spine_shoulder right_elbow<right_shoulder right_wrist<right_elbow"
    " right_hand<right_wrist"
    " left_hip<spine_base left_knee<left_hip left_ankle<left_knee left_foot<left_ankle"
    " right_hip<spine_base right_knee<right_hip right_ankle<right_knee right_foot<right_ankle"
    " spine_shoulder<spine_mid left_hand_tip<left_hand left_thumb<left_hand"
    " right_hand_tip<right_hand right_thumb<right_hand",
)

# Kinect v1 through NITE, as SBU publishes it (Yun et al. 2012).
SBU15 = _published(
    "sbu15",
    "head<neck neck<torso torso left_shoulder<neck left_elbow<left_shoulder left_hand<left_elbow"
    " right_shoulder<neck right_elbow<right_shoulder right_hand<right_elbow"
    " left_hip<torso left_knee<left_hip left_foot<left_knee"
    " right_hip<torso right_knee<right_hip right_foot<right_knee",
)

# LCR-Net's order with the two derived joints of DuetDance (Kundu et al. 2020); odd, 1-based: right.
DUET15 = _published(
    "duet15",
    "right_ankle<right_knee left_ankle<left_knee right_knee<right_hip left_knee<left_hip"
    " right_hip<pelvis left_hip<pelvis right_wrist<right_elbow left_wrist<left_elbow"
    " right_elbow<right_shoulder left_elbow<left_shoulder right_shoulder<neck left_shoulder<neck"
    " head<neck pelvis neck<pelvis",
)

# ExPI (Guo et al. 2022). Its published edges hang the legs on the back.
EXPI18 = _published(
    "expi18",
    "head_front<back left_head<head_front right_head<head_front back"
    " left_shoulder<back right_shoulder<back left_elbow<left_shoulder right_elbow<right_shoulder"
    " left_wrist<left_elbow right_wrist<right_elbow left_hip<back right_hip<back"
    " left_knee<left_hip right_knee<right_hip left_heel<left_knee right_heel<right_knee"
    " left_toe<left_heel right_toe<right_heel",
)

# The SMPL body without hands, as InterHuman publishes its joint positions (Liang et al. 2024).
INTERHUMAN22 = _published(
    "interhuman22",
    "pelvis left_hip<pelvis right_hip<pelvis spine1<pelvis left_knee<left_hip"
    " right_knee<right_hip spine2<spine1 left_ankle<left_knee right_ankle<right_knee"
    " spine3<spine2 left_foot<left_ankle right_foot<right_ankle neck<spine3"
    " left_collar<spine3 right_collar<spine3 head<neck left_shoulder<left_collar"
    " right_shoulder<right_collar left_elbow<left_shoulder right_elbow<right_shoulder"
    " left_wrist<left_elbow right_wrist<right_elbow",
)
