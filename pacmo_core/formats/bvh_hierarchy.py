"""The HIERARCHY part of a BVH file: the tree of joints, their offsets and channels.

The format is Biovision's, as the course notes of the University of Wisconsin (CS 838, 1999)
describe it. One joint or brace may share a line with the next; words are matched in any case.
"""

import re
from dataclasses import dataclass, field
from pathlib import Path

from pacmo_core.formats.raw import FormatError
from pacmo_core.formats.tables import parse_number

CHANNELS = tuple(f"{axis}{kind}" for kind in ("position", "rotation") for axis in "xyz")
MOST_JOINTS = 1000  # no body has more; bounds what a faulty file can cost
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
    wants_brace: bool = False

    def fault(self, line: int, reason: str) -> FormatError:
        """Make the error for a line of this file."""
        return FormatError(self.file, reason, line)

    def take(self, line: int, words: list[str]) -> None:
        """Read one statement, or a brace."""
        word = words[0].lower()
        if word not in KEYWORDS:
            wanted = "'{'" if self.wants_brace else "a joint, OFFSET, CHANNELS or a brace"
            raise self.fault(line, f"wanted {wanted}; got {words[0][:40]!r}")
        if self.wants_brace != (word == "{"):
            wanted = "wanted '{'" if self.wants_brace else "'{' opens no joint"
            raise self.fault(line, f"{wanted}; got {words[0]!r}")
        if word == "{":
            self.wants_brace = False
            self.unclosed.append(len(self.joints) - 1)
        elif word in ("root", "joint", "end"):
            self._joint(line, word, " ".join(words[1:]))
        else:
            self._inside(line, word, words[1:])

    def _joint(self, line: int, word: str, name: str) -> None:
        if word == "root" and self.joints:
            raise self.fault(line, f"a second ROOT, {name[:40]!r}: wanted one person a file")
        if word != "root" and not self.unclosed:
            raise self.fault(line, f"{name[:40]!r} has no parent: it stands outside the ROOT")
        if self.unclosed and self.unclosed[-1] in self.end_sites[-1:]:
            raise self.fault(line, "an End Site holds no joints")
        if word == "end":
            name = self._end_name(line, name)
            self.end_sites.append(len(self.joints))
        if not name or name in self.joints:
            raise self.fault(line, f"wanted a new name for the joint; got {name[:40]!r}")
        if len(self.joints) == MOST_JOINTS:
            raise self.fault(line, f"more than {MOST_JOINTS} joints: this is no body")
        self.joints.append(name)
        self.parents.append(self.unclosed[-1] if self.unclosed else -1)
        self.offsets.append([])
        self.channels.append(() if word == "end" else None)
        self.wants_brace = True

    def _end_name(self, line: int, word: str) -> str:
        if word.split()[:1] and word.split()[0].lower() != "site":
            raise self.fault(line, f"wanted 'End Site'; got 'End {word[:40]}'")
        name = f"{self.joints[self.unclosed[-1]]}_end"
        again = sum(joint.startswith(name) for joint in self.joints)
        return f"{name}{again + 1}" if again else name

    def _inside(self, line: int, word: str, values: list[str]) -> None:
        if not self.unclosed:
            raise self.fault(line, f"{word!r} stands outside the ROOT")
        joint = self.unclosed[-1]
        if word == "}":
            self._close(line, joint)
        elif word == "offset":
            if self.offsets[joint] or len(values) != 3:
                raise self.fault(line, f"wanted one OFFSET of 3 numbers; got {len(values)} more")
            self.offsets[joint] = [parse_number(self.file, line, value) for value in values]
        else:
            self._channels(line, joint, values)

    def _channels(self, line: int, joint: int, values: list[str]) -> None:
        names = tuple(value.lower() for value in values[1:])
        if self.channels[joint] is not None:
            raise self.fault(line, f"{self.joints[joint]} may not have these CHANNELS")
        if not values or values[0] != str(len(names)):
            stated = values[0][:40] if values else "none"
            raise self.fault(line, f"wanted as many channels as stated, {stated}; got {len(names)}")
        wrong = [name for name in names if name not in CHANNELS or names.count(name) > 1]
        if wrong:
            raise self.fault(line, f"wanted channels {', '.join(CHANNELS)}; got {wrong[0][:40]!r}")
        self.channels[joint] = names

    def _close(self, line: int, joint: int) -> None:
        if not self.offsets[joint] or self.channels[joint] is None:
            missing = "CHANNELS" if self.offsets[joint] else "OFFSET"
            raise self.fault(line, f"{self.joints[joint]} has no {missing}")
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
            if hierarchy.unclosed or hierarchy.wants_brace or not hierarchy.joints:
                unclosed = len(hierarchy.unclosed)
                raise FormatError(file, f"MOTION while {unclosed} braces are unclosed", number)
            return hierarchy, number
        for statement in re.findall(r"[{}]|[^{}]+", line):
            if statement.strip():
                hierarchy.take(number, statement.split())
    raise FormatError(file, "the file ends before MOTION", len(lines))
