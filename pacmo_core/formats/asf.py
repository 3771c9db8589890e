"""Acclaim skeleton files (ASF): bones with a direction, a length, axes and degrees of freedom."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pacmo_core.formats.kinematics import still_frames, turn
from pacmo_core.formats.raw import FormatError
from pacmo_core.formats.tables import parse_number, read_lines

ROOT_DOF = ("tx", "ty", "tz", "rx", "ry", "rz")
MOST_BONES = 1000  # no body has more; bounds what a faulty file can cost
Words = tuple[list[str], int]


@dataclass(frozen=True)
class Asf:
    """A skeleton at rest.

    Parameters
    ----------
    joints : ``root``, then each bone's far end under the bone's name, parents first
    parents : index of each joint's parent; -1 for the root
    bones : (J, 3) from the parent's far end to this one's, file units
    axes : (J, 3, 3) from the world to the bone's own axes, on column vectors
    dof : the numbers of the bone's line in an AMC file, in order; none for a stiff bone
    length_unit : file units times this are inches
    """

    joints: tuple[str, ...]
    parents: tuple[int, ...]
    bones: NDArray[np.float64]
    axes: NDArray[np.float64]
    dof: tuple[tuple[str, ...], ...]
    length_unit: float


@dataclass
class _Bone:
    name: str = ""
    values: dict[str, Words] = field(default_factory=dict)


def read_asf(file: Path) -> Asf:
    """Read a skeleton.

    Raises
    ------
    FormatError
        If a section is missing or the bones form no tree.
    """
    sections = _sections(file)
    unit = _length_unit(file, sections)
    stated = _values(file, sections, "root")
    order = tuple(word.lower() for word in stated.get("order", ([], 0))[0])
    if sorted(order) != sorted(ROOT_DOF):
        raise FormatError(file, f"wanted a root order of {ROOT_DOF}; got {order[:8]}")
    bones = _bones(file, sections)
    tree = _tree(file, sections, bones)
    rows = [_bone(file, bones[name]) for name, _ in tree]
    rest = [_numbers(file, stated, word, 3) for word in ("position", "orientation")]
    if np.any(rest):
        raise FormatError(file, "wanted a root at rest in the origin, as CMU writes it")
    return Asf(
        joints=("root", *(name for name, _ in tree)),
        parents=(-1, *(parent for _, parent in tree)),
        bones=np.array([np.zeros(3), *(row[0] for row in rows)]),
        axes=np.array([np.eye(3), *(row[1] for row in rows)]),
        dof=(order, *(row[2] for row in rows)),
        length_unit=unit,
    )


def _sections(file: Path) -> dict[str, list[Words]]:
    """Split the file at its ``:words``; each holds the words of its lines and their numbers."""
    sections: dict[str, list[Words]] = {}
    lines: list[Words] = []
    for number, line in enumerate(read_lines(file), 1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        if words[0].startswith(":"):
            lines = sections.setdefault(words[0][1:].lower(), [])
        else:
            lines.append((words, number))
    return sections


def _section(file: Path, sections: dict[str, list[Words]], name: str) -> list[Words]:
    if not sections.get(name):
        raise FormatError(file, f"the section :{name} is missing or empty")
    return sections[name]


def _values(file: Path, sections: dict[str, list[Words]], name: str) -> dict[str, Words]:
    lines = _section(file, sections, name)
    return {words[0].lower(): (words[1:], number) for words, number in lines}


def _length_unit(file: Path, sections: dict[str, list[Words]]) -> float:
    units = _values(file, sections, "units")
    angle, line = units.get("angle", ([], 0))
    if [word.lower() for word in angle] != ["deg"]:
        raise FormatError(file, f"wanted angles in deg; got {angle[:3]}", line or None)
    length = float(_numbers(file, units, "length", 1)[0])
    if not 1e-3 <= length <= 1e3:
        reason = f"wanted a length unit of 0.001 to 1000; got {length}"
        raise FormatError(file, reason, units["length"][1])
    return length


def _numbers(file: Path, values: dict[str, Words], word: str, count: int) -> NDArray[np.float64]:
    words, line = values.get(word, ([], 0))
    if len(words) < count:
        raise FormatError(file, f"wanted {word} with {count} numbers; got {words}", line or None)
    return np.array([parse_number(file, line, number) for number in words[:count]])


def _bones(file: Path, sections: dict[str, list[Words]]) -> dict[str, _Bone]:
    """Collect the blocks ``begin`` to ``end``."""
    bones: dict[str, _Bone] = {}
    bone: _Bone | None = None
    for words, number in _section(file, sections, "bonedata"):
        word = words[0].lower()
        if (word == "begin") != (bone is None):
            raise FormatError(file, f"wanted a bone's begin and end; got {word[:40]!r}", number)
        if word == "begin":
            bone = _Bone()
        elif word == "end" and bone is not None:
            bone.name = " ".join(bone.values.get("name", ([], 0))[0])
            if not bone.name or bone.name in {*bones, "root"} or len(bones) == MOST_BONES:
                raise FormatError(file, f"wanted a new bone; got {bone.name[:40]!r}", number)
            bones[bone.name] = bone
            bone = None
        elif bone is not None:
            bone.values.setdefault(word, (words[1:], number))
    if bone is not None:
        raise FormatError(file, "the file ends inside a bone")
    return bones


def _bone(
    file: Path, bone: _Bone
) -> tuple[NDArray[np.float64], NDArray[np.float64], tuple[str, ...]]:
    direction = _numbers(file, bone.values, "direction", 3)
    (length,) = _numbers(file, bone.values, "length", 1)
    order = bone.values.get("axis", ([], 0))[0][3:]
    axes = _axes(file, bone.values, "axis", "".join(order))
    dof, line = bone.values.get("dof", ([], 0))
    names = tuple(word.lower() for word in dof)
    if len(set(names)) != len(names) or not set(names) <= {"rx", "ry", "rz"}:
        raise FormatError(file, f"wanted dof of rx, ry, rz; got {names[:8]}", line)
    return direction * length, axes, names


def _axes(file: Path, values: dict[str, Words], word: str, order: str) -> NDArray[np.float64]:
    """``(3, 3)``: turns about x, y, z in the order stated, the first one innermost."""
    angles = _numbers(file, values, word, 3)
    if sorted(order.lower()) != ["x", "y", "z"]:
        line = values[word][1]
        raise FormatError(file, f"wanted an axis order such as XYZ; got {order[:10]!r}", line)
    frame = still_frames(1)
    for place in (2, 1, 0):
        frame = turn(frame, "xyz".index(order[place].lower()), angles[place : place + 1])
    return frame[:, :, 0].T


def _tree(
    file: Path, sections: dict[str, list[Words]], bones: dict[str, _Bone]
) -> list[tuple[str, int]]:
    """List (bone, index of its parent joint), parents first; the root is joint 0."""
    places, tree = {"root": 0}, []
    for words, number in _section(file, sections, "hierarchy"):
        if words[0].lower() in ("begin", "end"):
            continue
        for name in words[1:]:
            if words[0] not in places or name in places or name not in bones:
                reason = f"{words[0][:40]!r} cannot be the parent of {name[:40]!r}"
                raise FormatError(file, f"{reason}: unknown, or not in a tree's order", number)
            places[name] = len(places)
            tree.append((name, places[words[0]]))
    if len(tree) != len(bones):
        raise FormatError(file, f"the hierarchy holds {len(tree)} of {len(bones)} bones")
    return tree
