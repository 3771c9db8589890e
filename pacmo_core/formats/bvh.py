"""BVH files: one person's tree of joints and their channels, and where the joints are.

Documented by the course notes of the University of Wisconsin (CS 838, 1999). Angles are degrees;
a joint's turns apply in the order of its channels, each about the axes that the last one left.
Units, the axis that is up and the truth of the stated rate are not in the file.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pacmo_core.formats.bvh_hierarchy import Hierarchy, parse_hierarchy
from pacmo_core.formats.kinematics import Frames, carry, still_frames, turn
from pacmo_core.formats.people import FASTEST, SLOWEST
from pacmo_core.formats.raw import FormatError
from pacmo_core.formats.tables import parse_number, parse_rows, read_lines


@dataclass(frozen=True)
class Bvh:
    """One BVH file as written.

    Parameters
    ----------
    joints : names in file order; an End Site of joint ``x`` is the joint ``x_end``
    parents : index of each joint's parent, always smaller than its own; -1 for the root
    offsets : (J, 3) from the parent, file units
    channels : of each joint, lower case, in file order; none for an End Site
    end_sites : which joints are End Sites
    frame_time : seconds, as the file states it
    motion : (T, C) degrees and file units
    """

    joints: tuple[str, ...]
    parents: tuple[int, ...]
    offsets: NDArray[np.float64]
    channels: tuple[tuple[str, ...], ...]
    end_sites: tuple[int, ...]
    frame_time: float
    motion: NDArray[np.float64]

    def positions(self) -> NDArray[np.float64]:
        """``(T, J, 3)`` file units: where every joint is in the file's world.

        The root's position channels add to its offset, as the format's description has it.
        Unlike there, another joint's position channels stand in the place of its offset: the
        description gives them to the root alone, and programs that write them write the whole
        displacement from the parent.
        """
        count = len(self.motion)
        places = np.zeros((count, len(self.joints), 3))
        frames: list[Frames] = []
        first = 0
        for joint, parent in enumerate(self.parents):
            last = first + len(self.channels[joint])
            values = self.motion[:, first:last]
            above = frames[parent] if parent >= 0 else still_frames(count)
            places[:, joint] = carry(above, self._displacement(joint, values))
            if parent >= 0:
                places[:, joint] += places[:, parent]
            frames.append(_turned(above, self.channels[joint], values))
            first = last
        return places

    def _displacement(self, joint: int, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """``(T, 3)`` from the parent, in the parent's frame."""
        moved = np.repeat(self.offsets[joint][None], len(values), axis=0)
        for column, channel in enumerate(self.channels[joint]):
            if channel.endswith("position"):
                axis = "xyz".index(channel[0])
                base = moved[:, axis] if self.parents[joint] < 0 else 0.0
                moved[:, axis] = base + values[:, column]
        return moved


def read_bvh(file: Path) -> Bvh:
    """Read one BVH file.

    Raises
    ------
    FormatError
        If the text is not a BVH of one person, or its header contradicts its rows.
    """
    lines = read_lines(file)
    hierarchy, taken = parse_hierarchy(file, lines)
    rows = [(text, line) for line, text in enumerate(lines[taken:], taken + 1) if text.strip()]
    frame_count = _stated(file, rows[:1], "Frames:", len(lines))
    frame_time = _stated(file, rows[1:2], "Frame Time:", len(lines))
    if not 1 / FASTEST <= frame_time <= 1 / SLOWEST:
        raise FormatError(file, f"no capture has a Frame Time of {frame_time:g} s", rows[1][1])
    rows = rows[2:]
    if frame_count != len(rows):
        reason = f"the header says {frame_count:g} frames, the file has {len(rows)} rows"
        raise FormatError(file, reason, taken + 1)
    return _built(file, hierarchy, frame_time, rows)


def _built(file: Path, hierarchy: Hierarchy, frame_time: float, rows: list[tuple[str, int]]) -> Bvh:
    channels = tuple(names or () for names in hierarchy.channels)
    texts, lines = [text for text, _ in rows], [line for _, line in rows]
    width = sum(len(names) for names in channels)
    if not rows or not width:
        raise FormatError(file, f"no motion: {len(rows)} rows of {width} channels")
    return Bvh(
        joints=tuple(hierarchy.joints),
        parents=tuple(hierarchy.parents),
        offsets=np.array(hierarchy.offsets),
        channels=channels,
        end_sites=tuple(hierarchy.end_sites),
        frame_time=frame_time,
        motion=parse_rows(file, texts, lines, width=width, delimiter=None),
    )


def _stated(file: Path, row: list[tuple[str, int]], wanted: str, last_line: int) -> float:
    """Read the number after a word of the MOTION header."""
    if not row:
        raise FormatError(file, f"the file ends before {wanted!r}", last_line)
    text, line = row[0]
    words = " ".join(text.split())
    if not words.lower().startswith(wanted.lower()):
        raise FormatError(file, f"wanted {wanted!r}; got {words[:40]!r}", line)
    return parse_number(file, line, words[len(wanted) :].strip())


def _turned(frames: Frames, channels: tuple[str, ...], values: NDArray[np.float64]) -> Frames:
    for column, channel in enumerate(channels):
        if channel.endswith("rotation"):
            frames = turn(frames, "xyz".index(channel[0]), values[:, column])
    return frames
