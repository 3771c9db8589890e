"""Two people, each read on their own, joined into one interaction."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.formats.raw import FormatError, Reading

UPS = ("y", "z")
SLOWEST, FASTEST = 0.1, 10_000.0  # frames a second
FARTHEST = 1e3  # metres: no capture volume is larger


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


def join(people: Sequence[Person]) -> Reading:
    """Put two people on one clock.

    Raises
    ------
    FormatError
        If there are not two, they differ in joints, rate or length, there is no motion, or a joint
        is farther away than any room.
    """
    if len(people) != 2:
        raise FormatError(people[0].file, f"no second person: wanted two files, got {len(people)}")
    a, b = people
    if a.skeleton != b.skeleton:
        raise FormatError(b.file, f"not the joints of {a.file.name}: {_difference(a, b)}")
    # Programs round a thirtieth of a second to six digits or to seven: a tenth of a millisecond
    # in a second at most, and one clock all the same.
    if not np.isclose(a.fps, b.fps, rtol=1e-4):
        raise FormatError(b.file, f"{b.fps:g} frames a second; {a.file.name} has {a.fps:g}")
    if len(a.positions) != len(b.positions):
        raise FormatError(
            b.file, f"{len(b.positions)} frames; {a.file.name} has {len(a.positions)}"
        )
    if len(a.positions) < 2:
        raise FormatError(a.file, f"wanted two frames or more; got {len(a.positions)}")
    for person in people:
        _check_near(person)
    interaction = Interaction(
        skeleton=a.skeleton,
        times=np.arange(len(a.positions)) / a.fps,
        person_a=a.positions.astype(np.float32),
        person_b=b.positions.astype(np.float32),
    )
    return Reading(interaction)


def upright(positions: NDArray[np.float64], up: str) -> NDArray[np.float64]:
    """Turn ``(..., 3)`` positions so that y is up: a rotation, so left stays left.

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
    """Raise ValueError unless ``up`` names an axis that captures stand on."""
    if up not in UPS:
        raise ValueError(f"up must be one of {UPS}; got {up!r}")


def check_fps(fps: float) -> None:
    """Raise ValueError unless ``fps`` is a rate that a capture can have."""
    if not SLOWEST <= fps <= FASTEST:
        raise ValueError(f"fps must be {SLOWEST:g} to {FASTEST:g}; got {fps}")


def _check_near(person: Person) -> None:
    far = np.argwhere(~(np.abs(person.positions) <= FARTHEST))
    if len(far):
        frame, joint = (int(i) for i in far[0][:2])
        place = person.positions[frame, joint].round(1).tolist()
        reason = f"frame {frame}, joint {person.skeleton.joints[joint]} is at {place} m"
        raise FormatError(person.file, f"{reason}; wanted at most {FARTHEST:g} m")


def _difference(a: Person, b: Person) -> str:
    """Say how two skeletons differ."""
    ours, theirs = set(b.skeleton.joints), set(a.skeleton.joints)
    extra, missing = sorted(ours - theirs), sorted(theirs - ours)
    if extra or missing:
        return f"{extra[:5]} more, {missing[:5]} missing"
    return "the same names in another order or tree"
