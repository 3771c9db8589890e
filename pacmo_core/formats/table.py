"""A table of joints: two people in one NPZ, Parquet or CSV file, with all that describes them.

The file states joints, parents, frame rate or times, unit, upward axis and the positions of
``person_a`` and ``person_b``; whatever else it holds is ignored. ``tables`` and
``table_columns`` read the files, this module checks them, and ``write_tables`` writes them.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.skeleton import OBJECT, Skeleton, mirror_by_name
from pacmo_core.formats.base import (
    MAX_DISTANCE,
    FormatError,
    Person,
    RawSequence,
    Reading,
    check_fps,
    check_up,
    pair_people,
    to_y_up,
)
from pacmo_core.formats.labels import CAPTURES_CSV
from pacmo_core.formats.pairing import matching_files
from pacmo_core.formats.resample import frame_rate
from pacmo_core.formats.table_columns import csv_arrays, table_arrays
from pacmo_core.formats.table_parquet import parquet_columns
from pacmo_core.formats.table_traps import check_layout, parents_hint, unit_hint, unit_of_word
from pacmo_core.formats.tables import npz_arrays, sequence_name

PEOPLE = ("person_a", "person_b")
KEYS = ("joints", "parents", "fps", "times", "unit", "up", *PEOPLE)
_WANTED = "joints, parents, fps or times, unit, up, person_a, person_b"
MAX_JOINTS = 1000  # a tree is checked in the square of their number
MAX_RATE_DIFFERENCE = 0.01  # of fps from the times, relative
RELEASED = 0.05  # metres farther from the nearest hand than while the thing is held
HELD_SHARE = 0.25  # of the frames, from the first, in which it is held
MAX_HELD = 1.0  # metres from the nearest hand: a thing that is farther is held by nobody

Arrays = Mapping[str, NDArray[np.generic]]


@dataclass(frozen=True, kw_only=True)
class Table:
    """Tables of joints; a setting replaces what the files state, or lack.

    Parameters
    ----------
    unit : metres per unit of the positions
    up : the axis that is up, ``y`` or ``z``
    fps : frames a second, in place of ``fps`` and ``times``
    object : whether the array ``object`` (T, 3) of an NPZ file, the place of a thing that person a
        holds at first, is a further joint: of person a there until it is released
        (``while_held``), of person b at the root
    """

    unit: float | None = None
    up: str | None = None
    fps: float | None = None
    object: bool = False

    def __post_init__(self) -> None:
        if self.unit is not None:
            _check_unit(self.unit)
        if self.up is not None:
            check_up(self.up)
        if self.fps is not None:
            check_fps(self.fps)
        if self.object not in (True, False):
            raise ValueError(f"object must be true or false; got {self.object!r}")

    def find(self, root: Path) -> list[RawSequence]:
        """List every ``.npz``, ``.parquet`` and ``.csv`` file but ``captures.csv``.

        A sequence is named by its file without the suffix, unless two would have one name.
        """
        files = matching_files(root, r".*\.(npz|parquet|csv)")
        paths = [file.relative_to(root) for file in files if file != root / CAPTURES_CSV]
        counts = Counter(path.with_suffix("") for path in paths)
        named = {path: path.with_suffix("") for path in paths}
        names = {path: stem if counts[stem] == 1 else path for path, stem in named.items()}
        return sorted(
            (
                RawSequence(sequence_name(name.as_posix()), (root / path,), recording=str(name))
                for path, name in names.items()
            ),
            key=lambda sequence: sequence.name,
        )

    def read(self, sequence: RawSequence) -> Reading:
        """Read both people from one file.

        Raises
        ------
        FormatError
            If the file is broken, or a value that it must state is missing or impossible.
        """
        (file,) = sequence.files
        arrays = self._read_arrays(file)
        reading = pair_people([self._person(file, arrays, name) for name in PEOPLE])
        n_frames = len(reading.interaction.times)
        times = self._times(file, arrays, n_frames)
        return replace(reading, interaction=replace(reading.interaction, times=times))

    def read_undescribed(self, file: Path) -> "UndescribedTable":
        """Read what of unit and upward axis a file does not state, and the positions as they are.

        Raises
        ------
        FormatError
            As ``read``.
        """
        arrays = self._read_arrays(file)
        skeleton = _skeleton(file, arrays)
        people = [
            _positions(file, arrays, name, skeleton)
            for name in PEOPLE
            if name in arrays or name == PEOPLE[0]
        ]
        stated = {"unit": self.unit, "up": self.up}
        unstated = [name for name, value in stated.items() if value is None and name not in arrays]
        return UndescribedTable(skeleton, people, unstated)

    def read_single(
        self, file: Path
    ) -> tuple[Skeleton, NDArray[np.float64], NDArray[np.float32]] | None:
        """Read a table of person a alone: skeleton, times and motion, as ``Interaction`` has them.

        None if the table has a person b too.

        Raises
        ------
        FormatError
            As ``read``.
        """
        arrays = self._read_arrays(file)
        if "person_b" in arrays:
            return None
        person = self._person(file, arrays, "person_a")
        motion = pair_people([person, person]).interaction.person_a
        return person.skeleton, self._times(file, arrays, len(motion)), motion

    def _read_arrays(self, file: Path) -> Arrays:
        if not self.object:
            return _read_arrays(file)
        arrays = _read_arrays(file, OBJECT)
        skeleton = _skeleton(file, arrays)
        positions = _positions(file, arrays, PEOPLE[0], skeleton)
        return _with_object(file, arrays, skeleton, positions, self._unit(file, arrays, positions))

    def _unit(self, file: Path, arrays: Arrays, positions: NDArray[np.float64]) -> float:
        if self.unit is not None:
            return self.unit
        return _unit(file, arrays, positions, _skeleton(file, arrays))

    def _person(self, file: Path, arrays: Arrays, name: str) -> Person:
        skeleton = _skeleton(file, arrays)
        positions = _positions(file, arrays, name, skeleton)
        unit = self._unit(file, arrays, positions)
        up = self.up if self.up is not None else _text(file, arrays, "up")
        try:
            _check_unit(unit)
            in_metres = to_y_up(positions * unit, up)
        except ValueError as error:
            raise FormatError(file, str(error)) from error
        return Person(file, skeleton, in_metres, fps=1.0)  # the times replace those of any rate

    def _times(self, file: Path, arrays: Arrays, n_frames: int) -> NDArray[np.float64]:
        """Return the times, which start at zero."""
        stated = None if "fps" not in arrays else _number(file, arrays, "fps")
        fps = self.fps if self.fps is not None else stated
        try:
            if fps is not None:
                check_fps(fps)
        except ValueError as error:
            raise FormatError(file, str(error)) from error
        if self.fps is None and "times" in arrays:
            return _stated_times(file, arrays["times"], n_frames, stated)
        if fps is None:
            raise FormatError(file, f"neither fps nor times; got {', '.join(arrays)}")
        return np.arange(n_frames) / fps


def has_person_b(file: Path) -> bool:
    """Whether a table holds two people.

    Raises
    ------
    FormatError
        If the file is broken.
    """
    return "person_b" in _read_arrays(file)


@dataclass(frozen=True)
class UndescribedTable:
    """A table before its unit and upward axis are known.

    Parameters
    ----------
    skeleton : of all people
    people : one or two of (T, J, 3) float64, in the file's unit and axes
    unstated : ``unit`` and ``up``, if neither the file nor the settings state them
    """

    skeleton: Skeleton
    people: list[NDArray[np.float64]]
    unstated: list[str]


def _read_arrays(file: Path, *more: str) -> Arrays:
    """Read the arrays that a file has of ``KEYS``, and ``more`` of an NPZ file."""
    suffix = file.suffix.lower()
    if suffix == ".npz":
        return npz_arrays(file, (*KEYS, *more))
    if suffix == ".csv":
        return csv_arrays(file)
    return table_arrays(file, parquet_columns(file))


def _with_object(
    file: Path, arrays: Arrays, skeleton: Skeleton, held: NDArray[np.float64], unit: float
) -> Arrays:
    """Make the object, which person a holds at first, a joint: where it is until it is released.

    It is a child of the root, so that hands stay the ends of limbs, and a mirror image is one of
    the same body.

    Parameters
    ----------
    held : (T, J, 3) positions of person a, in ``unit`` metres
    """
    if OBJECT not in arrays:
        raise FormatError(
            file, f"no {OBJECT}: wanted (T, 3) in an NPZ file; got {', '.join(arrays)}"
        )
    if OBJECT in skeleton.joints:
        raise FormatError(file, f"joints: {OBJECT!r} is the name of a joint already")
    place = arrays[OBJECT]
    if place.dtype.kind not in "iuf" or place.shape != (len(held), 3):
        raise FormatError(
            file,
            f"{OBJECT}: wanted ({len(held)}, 3) numbers; got {place.shape} of {place.dtype}",
        )
    found = dict(arrays)
    found["joints"] = np.array([*skeleton.joints, OBJECT])
    found["parents"] = np.array([*skeleton.parents, skeleton.root])
    try:
        known = while_held(place.astype(np.float64), held, skeleton, unit)
    except ValueError as fault:
        raise FormatError(file, f"{OBJECT}: {fault}") from fault
    found[PEOPLE[0]] = np.concatenate([held, known[:, None]], axis=1)
    if PEOPLE[1] in arrays:
        other = _positions(file, arrays, PEOPLE[1], skeleton)
        found[PEOPLE[1]] = np.concatenate([other, other[:, [skeleton.root]]], axis=1)
    return found


def while_held(
    place: NDArray[np.float64], motion: NDArray[np.float64], skeleton: Skeleton, unit: float
) -> NDArray[np.float64]:
    """Return where a thing is while it is held, and afterwards would be in the hand that held it.

    Once the other person has it, its place is that of the other's hand: a model that generates this
    person must not be told.

    It is released at the first frame from which it stays ``RELEASED`` farther from the nearest hand
    than in the median of the first frames. It then keeps its offset to that hand.

    Parameters
    ----------
    place : (T, 3) of the thing
    motion : (T, J, 3) of the person who holds it
    skeleton : of the person; without a joint named a hand all ends of limbs are hands
    unit : metres a unit of both

    Raises
    ------
    ValueError
        If it is not held at first, as in another unit or other axes than the person.
    """
    named = [i for i, joint in enumerate(skeleton.joints) if "hand" in joint.lower()]
    hands = motion[:, named or list(skeleton.end_effectors)]
    gaps = np.linalg.norm(hands - place[:, None], axis=-1) * unit
    nearest = gaps.min(axis=1)
    first = max(1, round(HELD_SHARE * len(nearest)))
    usual = np.median(nearest[:first])
    if usual > MAX_HELD:
        raise ValueError(
            f"{usual:.3g} m from the nearest hand at first: wanted at most {MAX_HELD:g} m"
        )
    is_away = nearest > usual + RELEASED
    held = np.flatnonzero(~is_away)
    if not len(held) or held[-1] + 1 == len(place):
        return place
    last = held[-1]
    hand = hands[:, gaps[last].argmin()]
    moved: NDArray[np.float64] = place.copy()
    moved[last + 1 :] = hand[last + 1 :] + (place[last] - hand[last])
    return moved


def _skeleton(file: Path, arrays: Arrays) -> Skeleton:
    names = _get(file, arrays, "joints")
    if names.dtype.kind not in "US" or names.ndim != 1 or not 1 <= len(names) <= MAX_JOINTS:
        raise FormatError(
            file, f"joints: wanted 1 to {MAX_JOINTS} names; got {names.shape} of {names.dtype}"
        )
    joints = tuple(map(_decoded, names.tolist()))
    twice = [joint for joint, count in Counter(joints).items() if count > 1]
    if twice:
        raise FormatError(file, f"joints: {twice[0]!r} is the name of two")
    unprintable = [joint for joint in joints if not joint.isprintable()]
    if unprintable:
        raise FormatError(file, f"joints: wanted printable names; got {unprintable[0][:40]!r}")
    parents = _integers(_get(file, arrays, "parents"))
    if parents.dtype.kind not in "iu" or parents.shape != names.shape:
        raise FormatError(
            file,
            f"parents: wanted an integer for each of {len(joints)} joints, -1 for the root; "
            f"got {parents.shape} of {parents.dtype}",
        )
    try:
        return Skeleton("table", joints, tuple(parents.tolist()), mirror_by_name(joints))
    except ValueError as error:
        raise FormatError(file, f"{error}{parents_hint(joints, parents.tolist())}") from error


def _integers(array: NDArray[np.generic]) -> NDArray[np.generic]:
    """Return whole numbers as a row of integers: MATLAB holds them as a matrix of real numbers."""
    if array.dtype.kind not in "iuf" or array.size != max(array.shape, default=0):
        return array
    row = array.reshape(-1)
    numbers = row.astype(np.float64)
    is_whole = np.isfinite(numbers).all() and (np.abs(numbers) < 2**31).all()
    if not is_whole or (numbers % 1 != 0).any():
        return array
    return row.astype(np.int64)


def _positions(file: Path, arrays: Arrays, name: str, skeleton: Skeleton) -> NDArray[np.float64]:
    """Return (T, J, 3) in units of the file."""
    array = _get(file, arrays, name)
    joints = skeleton.joints
    first = arrays["person_a"]
    wanted = (len(first) if first.ndim else 0, len(joints), 3)
    if array.dtype.kind not in "iuf" or array.shape != wanted:
        raise FormatError(
            file,
            f"{name}: wanted (T, {len(joints)}, 3) numbers, as many frames of both people; "
            f"got {array.shape} of {array.dtype}",
        )
    positions: NDArray[np.float64] = array.astype(np.float64)
    wrong = np.argwhere(~np.isfinite(positions))
    if len(wrong):
        frame, joint = (int(i) for i in wrong[0][:2])
        raise FormatError(file, f"{name}: frame {frame}, joint {joints[joint]} is not finite")
    check_layout(file, name, positions, skeleton)
    return positions


def _stated_times(
    file: Path, array: NDArray[np.generic], n_frames: int, fps: float | None
) -> NDArray[np.float64]:
    if array.dtype.kind not in "iuf" or array.shape != (n_frames,):
        reason = f"wanted seconds of each of {n_frames} frames; got {array.shape} of {array.dtype}"
        raise FormatError(file, f"times: {reason}")
    times: NDArray[np.float64] = array.astype(np.float64)
    steps = np.diff(times)
    if not np.isfinite(times).all() or not (steps > 0).all():
        raise FormatError(file, "times: wanted seconds that increase from frame to frame")
    rate = frame_rate(times)
    try:
        check_fps(rate)
    except ValueError as error:
        raise FormatError(file, f"times: {error}") from error
    if fps is not None and abs(rate / fps - 1) > MAX_RATE_DIFFERENCE:
        raise FormatError(file, f"fps is {fps:g}, but times give {rate:g} frames a second")
    from_zero: NDArray[np.float64] = times - times[0]
    return from_zero


def _get(file: Path, arrays: Arrays, name: str) -> NDArray[np.generic]:
    if name not in arrays:
        raise FormatError(file, f"no {name}: wanted {_WANTED}; got {', '.join(arrays) or 'none'}")
    return arrays[name]


def _unit(file: Path, arrays: Arrays, positions: NDArray[np.float64], skeleton: Skeleton) -> float:
    """Return metres per unit, which a file may state by a word."""
    if "unit" in arrays and arrays["unit"].dtype.kind in "US":
        return unit_of_word(file, _text(file, arrays, "unit"))
    if "unit" not in arrays:
        raise FormatError(
            file,
            f"no unit: wanted {_WANTED}; got {', '.join(arrays)}{unit_hint(positions, skeleton)}",
        )
    return _number(file, arrays, "unit")


def _number(file: Path, arrays: Arrays, name: str) -> float:
    array = _get(file, arrays, name)
    if array.dtype.kind not in "iuf" or array.size != 1:
        raise FormatError(file, f"{name}: wanted a number; got {array.shape} of {array.dtype}")
    return float(array.astype(np.float64).reshape(()))


def _text(file: Path, arrays: Arrays, name: str) -> str:
    array = _get(file, arrays, name)
    if array.dtype.kind not in "US" or array.size != 1:
        raise FormatError(file, f"{name}: wanted text; got {array.shape} of {array.dtype}")
    return _decoded(array.reshape(-1).tolist()[0])


def _decoded(text: str | bytes) -> str:
    return text if isinstance(text, str) else text.decode("utf-8", "replace")


def _check_unit(unit: float) -> None:
    if not 0 < unit <= MAX_DISTANCE:
        raise ValueError(f"unit must be > 0 and <= {MAX_DISTANCE:g} metres; got {unit}")
