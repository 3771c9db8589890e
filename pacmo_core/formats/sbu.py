"""SBU Kinect Interaction: ``<sXXsYY>/<action>/<take>/skeleton_pos.txt``, two people a line.

A line is 91 comma-separated values: a frame number, then 15 joints x y z of the first and of the
second person, normalised. Yun et al. (2012) give millimetres as 1280 - 2560 x, 960 - 1920 y and
10000 z / 7.8125. These are y up, z away from the camera and, by the minus sign of x, right-handed:
the joints called left are then on the left of people who face each other and bend their knees
forwards. The frame rate is not in the file.

The axes are the camera's, which looked up: over all clips the height of standing feet falls by
0.17 to 0.20 m for each metre from the camera, and people lean away from it by 8.7 degrees, in each
of the 21 pairs by 5 to 13. So the axes are turned to the floor's (``camera_pitch``).
"""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.skeleton import SBU15
from pacmo_core.formats.base import FormatError, RawSequence, Reading, check_fps, check_work
from pacmo_core.formats.pairing import matching_files
from pacmo_core.formats.tables import (
    MAX_COORDINATE,
    is_number,
    parse_count,
    parse_floats,
    quote,
    read_bytes,
    sequence_name,
)

ACTIONS = {
    "01": "approaching",
    "02": "departing",
    "03": "kicking",
    "04": "pushing",
    "05": "shaking hands",
    "06": "hugging",
    "07": "exchanging",
    "08": "punching",
}
MAX_PITCH = 45  # degrees
_N_JOINTS = len(SBU15.joints)
_N_FIELDS = 1 + 2 * _N_JOINTS * 3
# Metres: scale and shift of x, y, z.
_SCALE = np.array([-2.56, -1.92, 10 / 7.8125])
_SHIFT = np.array([1.28, 0.96, 0.0])


@dataclass(frozen=True, kw_only=True)
class Sbu:
    """SBU Kinect Interaction, read with these settings.

    Parameters
    ----------
    fps : frames a second; the paper says 15
    camera_pitch : degrees by which the camera looked up; 0 keeps its axes
    """

    fps: float
    camera_pitch: float = 9.5

    def __post_init__(self) -> None:
        check_fps(self.fps)
        if not abs(self.camera_pitch) <= MAX_PITCH:
            raise ValueError(
                f"camera_pitch: wanted degrees between -{MAX_PITCH} and {MAX_PITCH}; "
                f"got {self.camera_pitch}"
            )

    def find(self, root: Path) -> list[RawSequence]:
        """List every ``skeleton_pos.txt`` under ``root``, named by its folders."""
        return [_sequence(path, root) for path in matching_files(root, r"skeleton_pos\.txt")]

    def read(self, sequence: RawSequence) -> Reading:
        """Read one file.

        Raises
        ------
        FormatError
            If a line is not 91 finite numbers, or a frame is missing.
        """
        (file,) = sequence.files
        positions = _positions(_values(read_bytes(file), file), file, self.camera_pitch)
        person_a, person_b = np.ascontiguousarray(positions.swapaxes(0, 1))
        times = np.arange(len(positions)) / self.fps
        return Reading(Interaction(SBU15, times, person_a, person_b))


def _sequence(file: Path, root: Path) -> RawSequence:
    folder = file.parent.relative_to(root)
    name = folder.as_posix() if folder.parts else file.stem
    subjects = re.fullmatch(r"(s\d{2})(s\d{2})/(\d{2})/[^/]+", name)
    if not subjects:
        return RawSequence(sequence_name(name), (file,), recording=name)
    a, b, action = subjects.groups()
    return RawSequence(name, (file,), ACTIONS.get(action, ""), (a, b), recording=name)


def _values(data: bytes, file: Path) -> NDArray[np.float64]:
    """``(T, 91)``: the fields of every line.

    Raises
    ------
    FormatError
        If a line has other fields, there are fewer than two lines, or frames do not follow on.
    """
    lines = data.rstrip().split(b"\n")
    check_work(file, len(lines), _N_JOINTS)
    rows = [_row(text, file, line) for line, text in enumerate(lines, start=1)]
    if len(rows) < 2:
        raise FormatError(file, "wanted two frames or more, got one", 1)
    _check_frames([text.partition(b",")[0] for text in lines], file)
    return np.stack(rows)


def _row(text: bytes, file: Path, line: int) -> NDArray[np.float64]:
    """``(91,)``: the fields of one line."""
    n_fields = text.count(b",") + 1
    if n_fields != _N_FIELDS:
        raise FormatError(file, f"wanted {_N_FIELDS} fields, got {n_fields}", line)
    fields = text.split(b",")
    wrong = [field for field in fields if not is_number(field)]
    if wrong:
        raise FormatError(file, f"wanted numbers, got {quote(wrong[0])}", line)
    return parse_floats(fields)


def _check_frames(fields: list[bytes], file: Path) -> None:
    frames = [parse_count(field) for field in fields]
    first = frames[0]
    for i, frame in enumerate(frames):
        if first is None or frame != first + i:
            wanted = "a frame number" if first is None else f"frame {first + i}"
            raise FormatError(file, f"wanted {wanted}, got {quote(fields[i])}", i + 1)


def _positions(values: NDArray[np.float64], file: Path, camera_pitch: float) -> NDArray[np.float32]:
    """``(T, 2, 15, 3)`` metres, of a camera that looked up by ``camera_pitch`` degrees.

    Raises
    ------
    FormatError
        If a position is not finite, or further away than any room.
    """
    normalised = values[:, 1:].reshape(-1, 2, _N_JOINTS, 3)
    far = np.argwhere(~(np.abs(normalised) < MAX_COORDINATE))
    if len(far):
        frame, person, joint = far[0][:3]
        raise FormatError(
            file,
            f"wanted finite positions; joint {SBU15.joints[joint]} of person {person + 1} is at "
            f"{normalised[frame, person, joint].tolist()}",
            int(frame) + 1,
        )
    x, y, z = np.moveaxis(normalised * _SCALE + _SHIFT, -1, 0)
    sine, cosine = np.sin(np.radians(camera_pitch)), np.cos(np.radians(camera_pitch))
    level = np.stack([x, cosine * y + sine * z, cosine * z - sine * y], axis=-1)
    return level.astype(np.float32)
