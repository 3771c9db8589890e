"""The text of an NTU RGB+D ``.skeleton`` file: every body seen in every frame, as written.

A frame count; per frame a body count; per body an info line of 10 fields that opens with the
body's ID, a joint count (25) and 25 lines of 12 fields: x y z in metres, then depth and colour
pixels, an orientation and a tracking state, which are not read and need only look like numbers.
Format: Shahroudy et al. (2016), ``read_skeleton_file.m`` of their repository NTURGB-D.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.interaction import Motion
from pacmo_core.formats.raw import FormatError
from pacmo_core.formats.text import FARTHEST, count, floats, is_number, show

N_JOINTS = 25
_N_INFO, _N_FIELDS = 10, 12
_MOST_BODIES = 6  # a Kinect v2 follows no more
_NUMERIC = b"0123456789+-.eE \t\r\n"
# Bodies parsed at a time: the split fields of a file take ten times its size.
_CHUNK = 64


@dataclass(frozen=True)
class Sightings:
    """Bodies in the order of the file, one a row.

    Parameters
    ----------
    n_frames : frames in the file, with bodies or without
    frame : (N,) of each body, ascending
    body_id : the recorder's number for each body, exact: 17 digits do not fit a float
    line : 1-based, of each body's info line
    poses : (N, 25, 3) float32, metres
    """

    n_frames: int
    frame: NDArray[np.intp]
    body_id: list[int]
    line: list[int]
    poses: Motion


def parse(data: bytes, file: Path) -> Sightings:
    """Parse a whole file.

    Raises
    ------
    FormatError
        At the first line that is not what the format says.
    """
    lines = data.split(b"\n")
    n_frames = _count(lines, 0, file, "a frame count")
    bodies = list(_bodies(lines, n_frames, file))
    starts = [line for _, _, line in bodies]
    chunks = [starts[i : i + _CHUNK] for i in range(0, len(starts), _CHUNK)]
    poses = [_poses(lines, chunk, file) for chunk in chunks]
    return Sightings(
        n_frames=n_frames,
        frame=np.array([frame for frame, _, _ in bodies], dtype=np.intp),
        body_id=[body_id for _, body_id, _ in bodies],
        line=[line + 1 for line in starts],
        poses=np.concatenate([np.zeros((0, N_JOINTS, 3), np.float32), *poses]),
    )


def _bodies(lines: list[bytes], n_frames: int, file: Path) -> Iterator[tuple[int, int, int]]:
    """Walk the structure: (frame, body ID, 0-based info line) of each body."""
    line = 1
    for frame in range(n_frames):
        n_bodies = _count(lines, line, file, f"the body count of frame {frame} of {n_frames}")
        if n_bodies > _MOST_BODIES:
            raise FormatError(file, f"wanted 0 to {_MOST_BODIES} bodies, got {n_bodies}", line + 1)
        line += 1
        seen: set[int] = set()
        for _ in range(n_bodies):
            body_id = _body_id(lines, line, file)
            if body_id in seen:
                raise FormatError(file, f"body {body_id} twice in frame {frame}", line + 1)
            seen.add(body_id)
            yield frame, body_id, line
            line += 2 + N_JOINTS
    if any(map(bytes.strip, lines[line:])):
        raise FormatError(file, f"wanted the end after {n_frames} frames, got more", line + 1)


def _count(lines: list[bytes], line: int, file: Path, what: str) -> int:
    if line >= len(lines) or (line == len(lines) - 1 and not lines[line].strip()):
        raise FormatError(file, f"wanted {what}, got the end of the file", line + 1)
    value = count(lines[line])
    if value is None:
        raise FormatError(file, f"wanted {what}, got {show(lines[line])}", line + 1)
    return value


def _body_id(lines: list[bytes], line: int, file: Path) -> int:
    """Check a body's info line and joint count, and that all its lines are there."""
    if line + 2 + N_JOINTS > len(lines):
        reason = f"wanted a body of {2 + N_JOINTS} lines, got the end of the file"
        raise FormatError(file, reason, line + 1)
    info = lines[line].split()
    body_id = count(info[0]) if len(info) == _N_INFO else None
    if body_id is None:
        reason = f"wanted a body ID and {_N_INFO - 1} more fields, got {show(info)}"
        raise FormatError(file, reason, line + 1)
    if _count(lines, line + 1, file, "a joint count") != N_JOINTS:
        raise FormatError(file, f"wanted {N_JOINTS} joints, got {show(lines[line + 1])}", line + 2)
    return body_id


def _poses(lines: list[bytes], starts: list[int], file: Path) -> Motion:
    """``(n, 25, 3)`` float32: the positions of the bodies whose info lines are ``starts``."""
    numbers = [i for start in starts for i in range(start + 2, start + 2 + N_JOINTS)]
    rows = [lines[i].split() for i in numbers]
    unlike = b" ".join([lines[i] for i in numbers]).translate(None, _NUMERIC)
    if unlike or set(map(len, rows)) != {_N_FIELDS}:
        _check(rows, numbers, file)
    try:
        values = floats(field for row in rows for field in row[:3])
    except ValueError:
        _check(rows, numbers, file)
        raise
    far = np.flatnonzero(~(np.abs(values) < FARTHEST))
    if len(far):
        row = rows[far[0] // 3]
        reason = f"wanted finite metres below {FARTHEST:g}, got {show(row[:3])}"
        raise FormatError(file, reason, numbers[far[0] // 3] + 1)
    return values.astype(np.float32).reshape(-1, N_JOINTS, 3)


def _check(rows: list[list[bytes]], numbers: list[int], file: Path) -> None:
    """Look for the first joint line at fault, field by field."""
    for row, line in zip(rows, numbers, strict=True):
        if len(row) != _N_FIELDS:
            raise FormatError(
                file, f"wanted {_N_FIELDS} fields, got {len(row)}: {show(row)}", line + 1
            )
        wrong = [field for field in row if not is_number(field)]
        if wrong:
            raise FormatError(file, f"wanted numbers, got {show(wrong[0])}", line + 1)
