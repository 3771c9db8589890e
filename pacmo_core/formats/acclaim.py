"""Acclaim files, as CMU publishes them: a skeleton (ASF) and motion on it (AMC).

An ASF bone has a direction, a length and axes of its own; an AMC line rotates it about those axes.
With C the rotation from the world to a bone's axes, the bone's rotation against its parent is
C·Rz·Ry·Rx·C⁻¹, on column vectors. A joint is a bone's far end and has the bone's name.
A bone without ``dof`` does not rotate and has no AMC line.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.limits import MAX_JOINTS
from pacmo_core.formats.base import FormatError, check_work
from pacmo_core.formats.rotations import Frames, identity_frames, rotate_about_axis, to_world
from pacmo_core.formats.tables import parse_number, parse_rows, read_lines

ROOT_DOF = ("tx", "ty", "tz", "rx", "ry", "rz")
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
    dof : the numbers of the bone's line in an AMC file, in order; none for a rigid bone
    length_unit : file units times this are inches
    """

    joints: tuple[str, ...]
    parents: tuple[int, ...]
    bones: NDArray[np.float64]
    axes: NDArray[np.float64]
    dof: tuple[tuple[str, ...], ...]
    length_unit: float


@dataclass
class _BoneBlock:
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
    stated = _section_values(file, sections, "root")
    order = tuple(word.lower() for word in stated.get("order", ([], 0))[0])
    if sorted(order) != sorted(ROOT_DOF):
        raise FormatError(file, f"wanted a root order of {ROOT_DOF}; got {order[:8]}")
    bones = _bone_blocks(file, sections)
    tree = _hierarchy(file, sections, bones)
    rows = [_parse_bone(file, bones[name]) for name, _ in tree]
    rest = [_parse_numbers(file, stated, word, 3) for word in ("position", "orientation")]
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


def _require_section(file: Path, sections: dict[str, list[Words]], name: str) -> list[Words]:
    if not sections.get(name):
        raise FormatError(file, f"the section :{name} is missing or empty")
    return sections[name]


def _section_values(file: Path, sections: dict[str, list[Words]], name: str) -> dict[str, Words]:
    lines = _require_section(file, sections, name)
    return {words[0].lower(): (words[1:], number) for words, number in lines}


def _length_unit(file: Path, sections: dict[str, list[Words]]) -> float:
    units = _section_values(file, sections, "units")
    angle, line = units.get("angle", ([], 0))
    if [word.lower() for word in angle] != ["deg"]:
        raise FormatError(file, f"wanted angles in deg; got {angle[:3]}", line or None)
    length = float(_parse_numbers(file, units, "length", 1)[0])
    if not 1e-3 <= length <= 1e3:
        reason = f"wanted a length unit of 0.001 to 1000; got {length}"
        raise FormatError(file, reason, units["length"][1])
    return length


def _parse_numbers(
    file: Path, values: dict[str, Words], word: str, count: int
) -> NDArray[np.float64]:
    words, line = values.get(word, ([], 0))
    if len(words) < count:
        raise FormatError(file, f"wanted {word} with {count} numbers; got {words}", line or None)
    return np.array([parse_number(file, line, number) for number in words[:count]])


def _bone_blocks(file: Path, sections: dict[str, list[Words]]) -> dict[str, _BoneBlock]:
    """Collect the blocks ``begin`` to ``end``."""
    bones: dict[str, _BoneBlock] = {}
    bone: _BoneBlock | None = None
    for words, number in _require_section(file, sections, "bonedata"):
        word = words[0].lower()
        if (word == "begin") != (bone is None):
            raise FormatError(file, f"wanted a bone's begin and end; got {word[:40]!r}", number)
        if word == "begin":
            bone = _BoneBlock()
        elif word == "end" and bone is not None:
            bone.name = " ".join(bone.values.get("name", ([], 0))[0])
            if not bone.name or bone.name in {*bones, "root"} or len(bones) == MAX_JOINTS:
                raise FormatError(file, f"wanted a new bone; got {bone.name[:40]!r}", number)
            bones[bone.name] = bone
            bone = None
        elif bone is not None:
            bone.values.setdefault(word, (words[1:], number))
    if bone is not None:
        raise FormatError(file, "the file ends inside a bone")
    return bones


def _parse_bone(
    file: Path, bone: _BoneBlock
) -> tuple[NDArray[np.float64], NDArray[np.float64], tuple[str, ...]]:
    direction = _parse_numbers(file, bone.values, "direction", 3)
    (length,) = _parse_numbers(file, bone.values, "length", 1)
    order = bone.values.get("axis", ([], 0))[0][3:]
    axes = _bone_axes(file, bone.values, "axis", "".join(order))
    dof, line = bone.values.get("dof", ([], 0))
    names = tuple(word.lower() for word in dof)
    if len(set(names)) != len(names) or not set(names) <= {"rx", "ry", "rz"}:
        raise FormatError(file, f"wanted dof of rx, ry, rz; got {names[:8]}", line)
    return direction * length, axes, names


def _bone_axes(file: Path, values: dict[str, Words], word: str, order: str) -> NDArray[np.float64]:
    """``(3, 3)``: turns about x, y, z in the order stated, the first one innermost."""
    angles = _parse_numbers(file, values, word, 3)
    if sorted(order.lower()) != ["x", "y", "z"]:
        line = values[word][1]
        raise FormatError(file, f"wanted an axis order such as XYZ; got {order[:10]!r}", line)
    frame = identity_frames(1)
    for position in (2, 1, 0):
        frame = rotate_about_axis(
            frame, "xyz".index(order[position].lower()), angles[position : position + 1]
        )
    return frame[:, :, 0].T


def _hierarchy(
    file: Path, sections: dict[str, list[Words]], bones: dict[str, _BoneBlock]
) -> list[tuple[str, int]]:
    """List (bone, index of its parent joint), parents first; the root is joint 0."""
    positions, tree = {"root": 0}, []
    for words, number in _require_section(file, sections, "hierarchy"):
        if words[0].lower() in ("begin", "end"):
            continue
        for name in words[1:]:
            if words[0] not in positions or name in positions or name not in bones:
                reason = f"{words[0][:40]!r} cannot be the parent of {name[:40]!r}"
                raise FormatError(file, f"{reason}: unknown, or not in a tree's order", number)
            positions[name] = len(positions)
            tree.append((name, positions[words[0]]))
    if len(tree) != len(bones):
        raise FormatError(file, f"the hierarchy holds {len(tree)} of {len(bones)} bones")
    return tree


INCH = 0.0254


@dataclass(frozen=True)
class Amc:
    """A skeleton in motion.

    Parameters
    ----------
    asf : the skeleton
    motion : of each bone with degrees of freedom, (T, dof) degrees and file units
    """

    asf: Asf
    motion: dict[str, NDArray[np.float64]]

    def positions(self) -> NDArray[np.float64]:
        """``(T, J, 3)`` metres, y up: the root, then the far end of every bone.

        The file's length is in inches times its ``length`` unit.
        """
        root = self.motion["root"]
        count = len(root)
        positions = np.zeros((count, len(self.asf.joints), 3))
        frames: list[Frames] = []
        for joint, parent in enumerate(self.asf.parents):
            parent_frames = frames[parent] if parent >= 0 else identity_frames(count)
            frames.append(self._rotated(joint, parent_frames))
            if parent < 0:
                order = [self.asf.dof[0].index(name) for name in ("tx", "ty", "tz")]
                positions[:, joint] = root[:, order]
            else:
                bone = to_world(frames[joint], self.asf.bones[joint])
                positions[:, joint] = positions[:, parent] + bone
        return positions / self.asf.length_unit * INCH

    def _rotated(self, joint: int, parent_frames: Frames) -> Frames:
        """Rotate the parent's frame by C, the bone's angles from the last to the first, and C⁻¹."""
        axes = self.asf.axes[joint]
        frames = np.einsum("irt,ij->jrt", parent_frames, axes)
        values = self.motion.get(self.asf.joints[joint])
        if values is not None:
            for column, name in reversed(list(enumerate(self.asf.dof[joint]))):
                if name.startswith("r"):
                    frames = rotate_about_axis(frames, "xyz".index(name[1]), values[:, column])
        back: Frames = np.einsum("irt,ji->jrt", frames, axes)
        return back


def read_amc(asf_file: Path, amc_file: Path) -> Amc:
    """Read a skeleton and motion on it.

    Raises
    ------
    FormatError
        If a file is not Acclaim's, or they do not belong together.
    """
    asf = read_asf(asf_file)
    lines = read_lines(amc_file)
    kept = [
        (line.strip(), number)
        for number, line in enumerate(lines, 1)
        if line.strip() and line.lstrip()[0] not in "#:"
    ]
    if any(line.strip().lower() == ":radians" for line in lines):
        raise FormatError(amc_file, "wanted :DEGREES; got :RADIANS")
    moving = {name: dof for name, dof in zip(asf.joints, asf.dof, strict=True) if dof}
    check_work(amc_file, len(kept) // (1 + len(moving)), len(asf.joints))
    return Amc(asf, _parse_motion(amc_file, kept, moving))


def _parse_motion(
    file: Path, lines: list[tuple[str, int]], moving: dict[str, tuple[str, ...]]
) -> dict[str, NDArray[np.float64]]:
    """Split the lines into frames: a frame's number, then a line for each moving bone.

    The bones come in the same order in every frame, so each bone's lines form one table.
    """
    size = 1 + len(moving)
    order = [line.split()[0] for line, _ in lines[1:size]]
    _check_frames(file, lines, order, moving)
    tables = {}
    for row, name in enumerate(order, start=1):
        block = lines[row::size]
        texts = [" ".join(line.split()[1:]) for line, _ in block]
        numbers = [number for _, number in block]
        width = len(moving[name])
        tables[name] = parse_rows(file, texts, numbers, width=width, delimiter=None)
    return tables


def _check_frames(
    file: Path, lines: list[tuple[str, int]], order: list[str], moving: dict[str, tuple[str, ...]]
) -> None:
    """Check that every frame has its number and all bones, in the first frame's order."""
    if not lines:
        raise FormatError(file, "the file has no frames")
    if sorted(order) != sorted(moving):
        missing, extra = sorted(set(moving) - set(order)), sorted(set(order) - set(moving))
        reason = f"the first frame lacks {missing[:5]} and has {extra[:5]} that the ASF moves not"
        raise FormatError(file, reason, lines[0][1])
    first = lines[0][0]
    if not (first.isascii() and first.isdecimal()) or len(first) > 9:
        raise FormatError(file, f"wanted a frame's number; got {first[:40]!r}", lines[0][1])
    size = 1 + len(order)
    for i, (line, number) in enumerate(lines):
        frame, row = divmod(i, size)
        wanted = order[row - 1] if row else str(int(first) + frame)
        words = line.split(maxsplit=1)
        if words[0] != wanted or (row == 0) != (len(words) == 1):
            raise FormatError(file, f"wanted the line {wanted!r}; got {line[:40]!r}", number)
    if len(lines) % size:
        reason = f"the last frame has {len(lines) % size} of {size} lines"
        raise FormatError(file, reason, lines[-1][1])
