"""The interface of all raw formats, their errors, and the pairing of two people's motions."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.limits import MAX_BYTES, file_fault, printable, work_fault
from pacmo_core.data.skeleton import Skeleton

_MAX_REASON = 500  # characters


class FormatError(ValueError):
    """A raw file that cannot be read as what it claims to be.

    Parameters
    ----------
    file : the file at fault
    reason : what was wanted and what was got
    line : 1-based, where the format has lines
    """

    def __init__(self, file: Path, reason: str, line: int | None = None) -> None:
        # What a file holds is quoted in reasons, and may be long or obeyed by a terminal.
        short = reason if len(reason) <= _MAX_REASON else f"{reason[:_MAX_REASON]}..."
        self.file, self.reason, self.line = file, printable(short), line
        super().__init__(f"{file}:{line}: {self.reason}" if line else f"{file}: {self.reason}")

    def __reduce__(self) -> tuple[type["FormatError"], tuple[Path, str, int | None]]:
        """Pickle all three arguments: by default the message would be passed as the file."""
        return FormatError, (self.file, self.reason, self.line)


@dataclass(frozen=True)
class RawSequence:
    """One recording as shipped, listed but not yet read.

    Parameters
    ----------
    name : unique in its set and stable; letters, digits, ``_ - .`` and ``/``
    files : the files that hold it, person a's first where each person has one
    action : label of the dataset, empty if unknown
    subjects : person a and person b, empty if unknown
    recording : clips of one recording stay in one split
    """

    name: str
    files: tuple[Path, ...]
    action: str = ""
    subjects: tuple[str, str] = ("", "")
    recording: str = ""


@dataclass(frozen=True)
class Reading:
    """The result of reading one sequence.

    Parameters
    ----------
    interaction : both people
    filled_frames : poses of one person that the file lacks and the reader interpolated
    """

    interaction: Interaction
    filled_frames: int = 0


class Format(Protocol):
    """A reader of one raw format, its settings fixed."""

    def find(self, root: Path) -> list[RawSequence]:
        """List every sequence under ``root`` by name, without reading motion.

        A file that has the format's suffix and belongs to no sequence (one person's without the
        other's, say) is listed too: ``read`` raises with the reason.
        """
        ...

    def read(self, sequence: RawSequence) -> Reading:
        """Read one sequence into metres, y up, right-handed, seconds.

        Raises
        ------
        FormatError
            If a file is not what it should be: with the file, the line and the reason.
        """
        ...


def read_capture(reader: Format, sequence: RawSequence) -> Reading:
    """Read one sequence of any format within the limits of ``data.limits``.

    Raises
    ------
    FormatError
        If a file is not a regular file or is too large, before it is opened; if the motion is too
        large; and as ``Format.read``.
    """
    for file in sequence.files:
        check_file(file)
    reading = reader.read(sequence)
    interaction = reading.interaction
    check_work(sequence.files[0], len(interaction.times), len(interaction.skeleton.joints))
    return reading


def check_file(file: Path) -> None:
    """Raise FormatError unless a path is a regular file of at most ``MAX_BYTES``."""
    if fault := file_fault(file):
        raise FormatError(file, fault)


def check_work(file: Path, frames: int, joints: int) -> None:
    """Raise FormatError if a motion is larger than ``data.limits`` allows."""
    if fault := work_fault(frames, joints):
        raise FormatError(file, fault)


def read_content(file: Path) -> bytes:
    """Read a whole file of at most ``MAX_BYTES``.

    Raises
    ------
    FormatError
        If it cannot be read, is not a regular file, or is too large.
    """
    check_file(file)
    try:
        with file.open("rb") as stream:
            content = stream.read(MAX_BYTES + 1)  # it may have grown
    except OSError as error:
        raise FormatError(file, f"cannot be read: {error.strerror}") from error
    if len(content) > MAX_BYTES:
        raise FormatError(file, f"wanted at most {MAX_BYTES >> 20} MiB; got more")
    return content


UP_AXES = ("y", "z")
MIN_FPS, MAX_FPS = 0.1, 10_000.0  # frames a second
MAX_DISTANCE = 1e3  # metres: no capture volume is larger


@dataclass(frozen=True)
class Person:
    """One person as one file holds them.

    Parameters
    ----------
    file : where the motion was read from
    skeleton : the joints
    positions : (T, J, 3) float64, metres, y up, right-handed
    fps : frames a second
    """

    file: Path
    skeleton: Skeleton
    positions: NDArray[np.float64]
    fps: float


def pair_people(people: Sequence[Person]) -> Reading:
    """Join two people's motions into one interaction.

    Raises
    ------
    FormatError
        If there are not two, they differ in joints, rate or length, there is no motion, or a joint
        is more than ``MAX_DISTANCE`` away.
    """
    if len(people) != 2:
        raise FormatError(people[0].file, f"no second person: wanted two files, got {len(people)}")
    a, b = people
    for person in people:
        check_work(person.file, *person.positions.shape[:2])
    if a.skeleton != b.skeleton:
        difference = skeleton_difference(b.skeleton, a.skeleton)
        raise FormatError(b.file, f"not the joints of {a.file.name}: {difference}")
    # Programs round a thirtieth of a second to six or seven digits: at most a tenth of a
    # millisecond in a second, which does not count as another frame rate.
    if not np.isclose(a.fps, b.fps, rtol=1e-4):
        raise FormatError(b.file, f"{b.fps:g} frames a second; {a.file.name} has {a.fps:g}")
    if len(a.positions) != len(b.positions):
        raise FormatError(
            b.file, f"{len(b.positions)} frames; {a.file.name} has {len(a.positions)}"
        )
    if len(a.positions) < 2:
        raise FormatError(a.file, f"wanted two frames or more; got {len(a.positions)}")
    for person in people:
        _check_distance(person)
    interaction = Interaction(
        skeleton=a.skeleton,
        times=np.arange(len(a.positions)) / a.fps,
        person_a=a.positions.astype(np.float32),
        person_b=b.positions.astype(np.float32),
    )
    return Reading(interaction)


def to_y_up(positions: NDArray[np.float64], up: str) -> NDArray[np.float64]:
    """Rotate ``(..., 3)`` positions so that y is up; a rotation keeps left on the left.

    Raises
    ------
    ValueError
        If ``up`` is neither ``y`` nor ``z``.
    """
    check_up(up)
    if up == "y":
        return positions
    x, y, z = np.moveaxis(positions, -1, 0)
    return np.stack((x, z, -y), axis=-1)


def check_up(up: str) -> None:
    """Raise ValueError unless ``up`` is y or z."""
    if up not in UP_AXES:
        raise ValueError(f"up must be one of {UP_AXES}; got {up!r}")


def check_fps(fps: float, name: str = "fps") -> None:
    """Raise ValueError unless ``fps`` is a plausible capture rate."""
    if not MIN_FPS <= fps <= MAX_FPS:
        raise ValueError(f"{name} must be {MIN_FPS:g} to {MAX_FPS:g}; got {fps}")


def _check_distance(person: Person) -> None:
    far = np.argwhere(~(np.abs(person.positions) <= MAX_DISTANCE))
    if len(far):
        frame, joint = (int(i) for i in far[0][:2])
        position = person.positions[frame, joint].round(1).tolist()
        reason = f"frame {frame}, joint {person.skeleton.joints[joint]} is at {position} m"
        raise FormatError(person.file, f"{reason}; wanted at most {MAX_DISTANCE:g} m")


def skeleton_difference(skeleton: Skeleton, other: Skeleton) -> str:
    """Describe how a skeleton differs from another."""
    ours, theirs = set(skeleton.joints), set(other.joints)
    extra, missing = sorted(ours - theirs), sorted(theirs - ours)
    if extra or missing:
        return f"{extra[:5]} more, {missing[:5]} missing"
    return "the same names in another order or tree"
