"""Acclaim files: a skeleton (ASF), and motion on it (AMC), as CMU publishes them.

An ASF bone has a direction, a length and axes of its own; an AMC line turns it about those axes.
With C the turn from the world to a bone's axes, the bone turns by C·Rz·Ry·Rx·C⁻¹ against its
parent, on column vectors. A joint is a bone's far end and bears the bone's name. A bone without
``dof`` is stiff and has no AMC line.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pacmo_core.formats.asf import Asf, read_asf
from pacmo_core.formats.kinematics import Frames, carry, still_frames, turn
from pacmo_core.formats.raw import FormatError
from pacmo_core.formats.tables import parse_rows, read_lines

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
        places = np.zeros((count, len(self.asf.joints), 3))
        frames: list[Frames] = []
        for joint, parent in enumerate(self.asf.parents):
            above = frames[parent] if parent >= 0 else still_frames(count)
            frames.append(self._turned(joint, above))
            if parent < 0:
                order = [self.asf.dof[0].index(name) for name in ("tx", "ty", "tz")]
                places[:, joint] = root[:, order]
            else:
                bone = carry(frames[joint], self.asf.bones[joint])
                places[:, joint] = places[:, parent] + bone
        return places / self.asf.length_unit * INCH

    def _turned(self, joint: int, above: Frames) -> Frames:
        """Turn the parent's frame by C, the bone's turns from the last to the first, and C⁻¹."""
        axes = self.asf.axes[joint]
        frames = np.einsum("irt,ij->jrt", above, axes)
        values = self.motion.get(self.asf.joints[joint])
        if values is not None:
            for column, name in reversed(list(enumerate(self.asf.dof[joint]))):
                if name.startswith("r"):
                    frames = turn(frames, "xyz".index(name[1]), values[:, column])
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
    return Amc(asf, _motion(amc_file, kept, moving))


def _motion(
    file: Path, lines: list[tuple[str, int]], moving: dict[str, tuple[str, ...]]
) -> dict[str, NDArray[np.float64]]:
    """Split the lines into frames: a frame's number, then a line for each moving bone.

    The bones come in the same order in every frame, so each bone's lines form one table.
    """
    size = 1 + len(moving)
    order = [line.split()[0] for line, _ in lines[1:size]]
    _check_order(file, lines, order, moving)
    tables = {}
    for row, name in enumerate(order, start=1):
        block = lines[row::size]
        texts = [" ".join(line.split()[1:]) for line, _ in block]
        numbers = [number for _, number in block]
        width = len(moving[name])
        tables[name] = parse_rows(file, texts, numbers, width=width, delimiter=None)
    return tables


def _check_order(
    file: Path, lines: list[tuple[str, int]], order: list[str], moving: dict[str, tuple[str, ...]]
) -> None:
    """See that every frame has its number and all bones, in the first frame's order."""
    if not lines:
        raise FormatError(file, "the file has no frames")
    if sorted(order) != sorted(moving):
        missing, extra = sorted(set(moving) - set(order)), sorted(set(order) - set(moving))
        reason = f"the first frame lacks {missing[:5]} and has {extra[:5]} that the ASF moves not"
        raise FormatError(file, reason, lines[0][1])
    first = lines[0][0]
    if not first.isdecimal() or len(first) > 9:
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
