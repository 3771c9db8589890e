"""BVH files: one person's joint hierarchy and channels, and its forward kinematics.

Documented by the course notes of the University of Wisconsin (CS 838, 1999). Angles are degrees;
a joint's rotations apply in the order of its channels, each about the axes after the previous
one. Position channels are the position and replace OFFSET, the root's as any joint's. Units and the
upward axis are not in the file, and the stated frame rate may be wrong. One joint or brace may
share a line with the next; keywords are matched in any case.
"""

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.limits import MAX_JOINTS
from pacmo_core.formats.base import MAX_FPS, MIN_FPS, FormatError, check_work
from pacmo_core.formats.rotations import Frames, identity_frames, rotate_about_axis, to_world
from pacmo_core.formats.tables import parse_number, parse_rows, read_lines

CHANNELS = tuple(f"{axis}{kind}" for kind in ("position", "rotation") for axis in "xyz")
KEYWORDS = ("root", "joint", "end", "{", "}", "offset", "channels")


@dataclass
class Hierarchy:
    """Joints in file order, every parent before its children; End Sites are joints."""

    file: Path
    joints: list[str] = field(default_factory=list)
    parents: list[int] = field(default_factory=list)
    offsets: list[list[float]] = field(default_factory=list)
    channels: list[tuple[str, ...] | None] = field(default_factory=list)
    end_sites: list[int] = field(default_factory=list)
    unclosed: list[int] = field(default_factory=list)
    expects_brace: bool = False

    def error(self, line: int, reason: str) -> FormatError:
        """Make the error for a line of this file."""
        return FormatError(self.file, reason, line)

    def add(self, line: int, words: list[str]) -> None:
        """Read one statement, or a brace."""
        word = words[0].lower()
        if word not in KEYWORDS:
            wanted = "'{'" if self.expects_brace else "a joint, OFFSET, CHANNELS or a brace"
            raise self.error(line, f"wanted {wanted}; got {words[0][:40]!r}")
        if self.expects_brace != (word == "{"):
            wanted = "wanted '{'" if self.expects_brace else "'{' opens no joint"
            raise self.error(line, f"{wanted}; got {words[0]!r}")
        if word == "{":
            self.expects_brace = False
            self.unclosed.append(len(self.joints) - 1)
        elif word in ("root", "joint", "end"):
            self._add_joint(line, word, " ".join(words[1:]))
        else:
            self._add_property(line, word, words[1:])

    def _add_joint(self, line: int, word: str, name: str) -> None:
        if word == "root" and self.joints:
            raise self.error(line, f"a second ROOT, {name[:40]!r}: wanted one person a file")
        if word != "root" and not self.unclosed:
            raise self.error(line, f"{name[:40]!r} has no parent: it is outside the ROOT")
        if self.unclosed and self.unclosed[-1] in self.end_sites[-1:]:
            raise self.error(line, "an End Site holds no joints")
        if word == "end":
            name = self._end_name(line, name)
            self.end_sites.append(len(self.joints))
        if not name or name in self.joints:
            raise self.error(line, f"wanted a new name for the joint; got {name[:40]!r}")
        if len(self.joints) == MAX_JOINTS:
            raise self.error(line, f"more than {MAX_JOINTS} joints: not a body")
        self.joints.append(name)
        self.parents.append(self.unclosed[-1] if self.unclosed else -1)
        self.offsets.append([])
        self.channels.append(() if word == "end" else None)
        self.expects_brace = True

    def _end_name(self, line: int, word: str) -> str:
        if word.split()[:1] and word.split()[0].lower() != "site":
            raise self.error(line, f"wanted 'End Site'; got 'End {word[:40]}'")
        name = f"{self.joints[self.unclosed[-1]]}_end"
        again = sum(joint.startswith(name) for joint in self.joints)
        return f"{name}{again + 1}" if again else name

    def _add_property(self, line: int, word: str, values: list[str]) -> None:
        if not self.unclosed:
            raise self.error(line, f"{word!r} is outside the ROOT")
        joint = self.unclosed[-1]
        if word == "}":
            self._close_joint(line, joint)
        elif word == "offset":
            if self.offsets[joint] or len(values) != 3:
                raise self.error(line, f"wanted one OFFSET of 3 numbers; got {len(values)} more")
            self.offsets[joint] = [parse_number(self.file, line, value) for value in values]
        else:
            self._set_channels(line, joint, values)

    def _set_channels(self, line: int, joint: int, values: list[str]) -> None:
        names = tuple(value.lower() for value in values[1:])
        if self.channels[joint] is not None:
            raise self.error(line, f"{self.joints[joint]} may not have these CHANNELS")
        if not values or values[0] != str(len(names)):
            stated = values[0][:40] if values else "none"
            raise self.error(line, f"wanted as many channels as stated, {stated}; got {len(names)}")
        few = names[: len(CHANNELS) + 1]  # of seven, one is unknown or comes twice
        wrong = [name for name in few if name not in CHANNELS or few.count(name) > 1]
        if wrong:
            raise self.error(line, f"wanted channels {', '.join(CHANNELS)}; got {wrong[0][:40]!r}")
        self.channels[joint] = names

    def _close_joint(self, line: int, joint: int) -> None:
        if not self.offsets[joint] or self.channels[joint] is None:
            missing = "CHANNELS" if self.offsets[joint] else "OFFSET"
            raise self.error(line, f"{self.joints[joint]} has no {missing}")
        self.unclosed.pop()


def parse_hierarchy(file: Path, lines: list[str]) -> tuple[Hierarchy, int]:
    """Read the tree.

    Returns
    -------
    The hierarchy, and how many lines it took with the word MOTION.

    Raises
    ------
    FormatError
        If the text is no BVH, ends before MOTION, or its tree is broken.
    """
    hierarchy = Hierarchy(file)
    first = next(i for i, line in enumerate(lines) if line.strip())
    if lines[first].strip().lower() != "hierarchy":
        raise FormatError(file, f"wanted HIERARCHY; got {lines[first].strip()[:40]!r}", first + 1)
    for number, line in enumerate(lines[first + 1 :], start=first + 2):
        if line.strip().lower() == "motion":
            if hierarchy.unclosed or hierarchy.expects_brace or not hierarchy.joints:
                unclosed = len(hierarchy.unclosed)
                raise FormatError(file, f"MOTION while {unclosed} braces are unclosed", number)
            return hierarchy, number
        for statement in re.finditer(r"[{}]|[^{}]+", line):
            if words := statement[0].split():
                hierarchy.add(number, words)
    raise FormatError(file, "the file ends before MOTION", len(lines))


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
        """Return ``(T, J, 3)`` file units: joint positions in the file's world.

        Position channels replace the offset of their joint, the root's too, as Blender and the
        loaders of public datasets have it: a program writes in them the whole displacement from the
        parent, or the root's position in the world, and its offset is that of the rest pose.
        """
        count = len(self.motion)
        positions = np.zeros((count, len(self.joints), 3))
        frames: list[Frames] = []
        first = 0
        for joint, parent in enumerate(self.parents):
            last = first + len(self.channels[joint])
            values = self.motion[:, first:last]
            parent_frames = frames[parent] if parent >= 0 else identity_frames(count)
            positions[:, joint] = to_world(parent_frames, self._displacement(joint, values))
            if parent >= 0:
                positions[:, joint] += positions[:, parent]
            frames.append(_apply_rotations(parent_frames, self.channels[joint], values))
            first = last
        return positions

    def _displacement(self, joint: int, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """``(T, 3)`` from the parent, in the parent's frame."""
        displacement = np.repeat(self.offsets[joint][None], len(values), axis=0)
        for column, channel in enumerate(self.channels[joint]):
            if channel.endswith("position"):
                displacement[:, "xyz".index(channel[0])] = values[:, column]
        return displacement


def read_bvh(file: Path) -> Bvh:
    """Read one BVH file.

    Raises
    ------
    FormatError
        If the text is not a BVH of one person, or its header contradicts its rows.
    """
    lines = read_lines(file)
    hierarchy, n_lines = parse_hierarchy(file, lines)
    rows = [(text, line) for line, text in enumerate(lines[n_lines:], n_lines + 1) if text.strip()]
    frame_count = _header_number(file, rows[:1], "Frames:", len(lines))
    frame_time = _header_number(file, rows[1:2], "Frame Time:", len(lines))
    if not 1 / MAX_FPS <= frame_time <= 1 / MIN_FPS:
        raise FormatError(file, f"no capture has a Frame Time of {frame_time:g} s", rows[1][1])
    rows = rows[2:]
    if frame_count != len(rows):
        reason = f"the header says {frame_count:g} frames, the file has {len(rows)} rows"
        raise FormatError(file, reason, n_lines + 1)
    return _assemble(file, hierarchy, frame_time, rows)


def _assemble(
    file: Path, hierarchy: Hierarchy, frame_time: float, rows: list[tuple[str, int]]
) -> Bvh:
    channels = tuple(names or () for names in hierarchy.channels)
    texts, lines = [text for text, _ in rows], [line for _, line in rows]
    width = sum(len(names) for names in channels)
    if not rows or not width:
        raise FormatError(file, f"no motion: {len(rows)} rows of {width} channels")
    check_work(file, len(rows), len(channels))
    return Bvh(
        joints=tuple(hierarchy.joints),
        parents=tuple(hierarchy.parents),
        offsets=np.array(hierarchy.offsets),
        channels=channels,
        end_sites=tuple(hierarchy.end_sites),
        frame_time=frame_time,
        motion=parse_rows(file, texts, lines, width=width, delimiter=None),
    )


def _header_number(file: Path, row: list[tuple[str, int]], wanted: str, last_line: int) -> float:
    """Read the number after a word of the MOTION header."""
    if not row:
        raise FormatError(file, f"the file ends before {wanted!r}", last_line)
    text, line = row[0]
    words = " ".join(text.split())
    if not words.lower().startswith(wanted.lower()):
        raise FormatError(file, f"wanted {wanted!r}; got {words[:40]!r}", line)
    return parse_number(file, line, words[len(wanted) :].strip())


def _apply_rotations(
    frames: Frames, channels: tuple[str, ...], values: NDArray[np.float64]
) -> Frames:
    for column, channel in enumerate(channels):
        if channel.endswith("rotation"):
            frames = rotate_about_axis(frames, "xyz".index(channel[0]), values[:, column])
    return frames
