"""NTU RGB+D and NTU RGB+D 120: Kinect v2 ``.skeleton`` files of 25 joints.

The camera's frame is kept: metres, y up, z away from the camera, x to the left of one who looks
out of it. It is right-handed: in the published files a body's left is on its left. The frame rate
is not in the file. Format: Shahroudy et al. (2016), ``read_skeleton_file.m`` of their repository
NTURGB-D; Liu et al. (2019).

The text: a frame count; per frame a body count; per body an info line of 10 fields that opens with
the body's ID, a joint count (25) and 25 lines of 12 fields: x y z in metres, then depth and colour
pixels, an orientation and a tracking state, which are checked to be numbers and not used.

Tracking: the recorder gives a body a new ID whenever it loses it and finds it again, and sometimes
detects a body in the furniture. Detections of one ID are a track; a track that begins where
another has just ended is linked to it; of the tracks that are visible long enough, the two that
move most are the two people.
"""

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.interaction import Interaction, Motion
from pacmo_core.data.skeleton import NTU25
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

# Setup, camera, performer, replication, action.
_SAMPLE_NAME = re.compile(r"(S\d{3})(C\d{3})(P\d{3})(R\d{3})(A\d{3})")


@dataclass(frozen=True, kw_only=True)
class Ntu:
    """NTU RGB+D, read with these settings.

    Parameters
    ----------
    fps : frames a second; Kinect v2 records 30
    max_gap : the longest gap in frames that is interpolated, or after which a body may get a new ID
    max_link_distance : metres, at most, from the end of a track to the start of its continuation
    min_visible_share : share of the file's frames in which each of the two people must be visible
    skip_lists : files, as published, that list samples with missing skeletons
    """

    fps: float
    max_gap: int
    max_link_distance: float
    min_visible_share: float
    skip_lists: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        check_fps(self.fps)
        if min(self.max_gap, self.max_link_distance) < 0 or not 0 < self.min_visible_share <= 1:
            raise ValueError(
                "max_gap and max_link_distance must be >= 0, min_visible_share in (0, 1]; "
                f"got {self.max_gap}, {self.max_link_distance}, {self.min_visible_share}"
            )

    @cached_property
    def skipped(self) -> frozenset[str]:
        """The names on the lists.

        Raises
        ------
        OSError
            If there is no such list: samples known to be faulty must not be read.
        """
        texts = [Path(name).read_text(encoding="utf-8") for name in self.skip_lists]
        return frozenset[str]().union(*map(read_skip_list, texts))

    def find(self, root: Path) -> list[RawSequence]:
        """List every ``.skeleton`` file under ``root``, those of one person too.

        A file name that occurs in several folders is distinguished by its folder.
        """
        files = matching_files(root, r".*\.skeleton")
        times = Counter(path.stem for path in files)
        return [
            _sequence(path.stem if times[path.stem] == 1 else _folder_name(path, root), path)
            for path in files
        ]

    def read(self, sequence: RawSequence) -> Reading:
        """Read one file; the two people are in order of appearance.

        Raises
        ------
        FormatError
            If the sample is listed as faulty, the text is faulty, or two people cannot be tracked.
        """
        (file,) = sequence.files
        if file.stem in self.skipped:
            raise FormatError(file, "listed among the samples with missing skeletons")
        detections = parse_skeleton_text(read_bytes(file), file)
        linked = link_tracks(make_tracks(detections), self.max_gap, self.max_link_distance)
        a, b = select_two_most_active(linked, detections.n_frames, self.min_visible_share, file)
        frames = common_frames(a, b, file)
        person_a, n_a = interpolate_gaps(a, frames, self.max_gap, file)
        person_b, n_b = interpolate_gaps(b, frames, self.max_gap, file)
        times = np.arange(len(frames)) / self.fps
        return Reading(Interaction(NTU25, times, person_a, person_b), filled_frames=n_a + n_b)


def read_skip_list(text: str) -> frozenset[str]:
    """Take the sample names from a published list of samples with missing skeletons."""
    return frozenset(
        line.strip() for line in text.splitlines() if _SAMPLE_NAME.fullmatch(line.strip())
    )


def _sequence(name: str, file: Path) -> RawSequence:
    """Label a file by its name, which holds one performer's ID; the partner's is unknown."""
    match = _SAMPLE_NAME.fullmatch(file.stem)
    name = sequence_name(name)
    if not match:
        return RawSequence(name, (file,), recording=name)
    setup, _, performer, replication, action = match.groups()
    return RawSequence(
        name=name,
        files=(file,),
        action=f"{action} {ACTIONS.get(action, '')}".strip(),
        subjects=(performer, ""),
        # Without the camera: three of them see one performance.
        recording=setup + performer + replication + action,
    )


def _folder_name(file: Path, root: Path) -> str:
    return file.relative_to(root).with_suffix("").as_posix()


# The two-person actions of NTU RGB+D 120 by their codes (Liu et al. 2019, table 2).
ACTIONS = {
    "A050": "punch or slap",
    "A051": "kick",
    "A052": "push",
    "A053": "pat on the back",
    "A054": "point a finger",
    "A055": "hug",
    "A056": "give an object",
    "A057": "touch a pocket",
    "A058": "shake hands",
    "A059": "walk towards each other",
    "A060": "walk apart",
    "A106": "hit with an object",
    "A107": "wield a knife",
    "A108": "knock over",
    "A109": "grab belongings",
    "A110": "shoot with a gun",
    "A111": "step on a foot",
    "A112": "high five",
    "A113": "cheers and drink",
    "A114": "carry an object together",
    "A115": "take a photo",
    "A116": "follow",
    "A117": "whisper",
    "A118": "exchange things",
    "A119": "support somebody",
    "A120": "rock, paper, scissors",
}


_N_JOINTS = 25
_N_INFO, _N_FIELDS = 10, 12
_MAX_TRACKS = 1000  # IDs in a file: each track is compared with those before it
_MAX_BODIES = 6  # limit of Kinect v2
_NUMERIC = b"0123456789+-.eE \t\r\n"
# Bodies parsed at a time: the split fields of a file take ten times its size.
_BODIES_PER_CHUNK = 64


@dataclass(frozen=True)
class Detections:
    """Body detections in the order of the file, one a row.

    Parameters
    ----------
    n_frames : frames in the file, with bodies or without
    frame : (N,) of each body, ascending
    body_id : the recorder's ID of each body, exact: 17 digits do not fit a float
    line : 1-based, of each body's info line
    poses : (N, 25, 3) float32, metres
    """

    n_frames: int
    frame: NDArray[np.intp]
    body_id: list[int]
    line: list[int]
    poses: Motion


def parse_skeleton_text(data: bytes, file: Path) -> Detections:
    """Parse a whole file.

    Raises
    ------
    FormatError
        At the first line that is not what the format says.
    """
    lines = data.split(b"\n")
    n_frames = _parse_count_line(lines, 0, file, "a frame count")
    bodies = list(_locate_bodies(lines, n_frames, file))
    check_work(file, n_frames, _N_JOINTS)
    starts = [line for _, _, line in bodies]
    chunks = [starts[i : i + _BODIES_PER_CHUNK] for i in range(0, len(starts), _BODIES_PER_CHUNK)]
    n_tracks = len({body_id for _, body_id, _ in bodies})
    if n_tracks > _MAX_TRACKS:
        raise FormatError(file, f"wanted at most {_MAX_TRACKS} body IDs; got {n_tracks}")
    poses = [_poses(lines, chunk, file) for chunk in chunks]
    return Detections(
        n_frames=n_frames,
        frame=np.array([frame for frame, _, _ in bodies], dtype=np.intp),
        body_id=[body_id for _, body_id, _ in bodies],
        line=[line + 1 for line in starts],
        poses=np.concatenate([np.zeros((0, _N_JOINTS, 3), np.float32), *poses]),
    )


def _locate_bodies(lines: list[bytes], n_frames: int, file: Path) -> Iterator[tuple[int, int, int]]:
    """Yield (frame, body ID, 0-based info line) of each body."""
    line = 1
    for frame in range(n_frames):
        n_bodies = _parse_count_line(
            lines, line, file, f"the body count of frame {frame} of {n_frames}"
        )
        if n_bodies > _MAX_BODIES:
            raise FormatError(file, f"wanted 0 to {_MAX_BODIES} bodies, got {n_bodies}", line + 1)
        line += 1
        body_ids: set[int] = set()
        for _ in range(n_bodies):
            body_id = _body_id(lines, line, file)
            if body_id in body_ids:
                raise FormatError(file, f"body {body_id} twice in frame {frame}", line + 1)
            body_ids.add(body_id)
            yield frame, body_id, line
            line += 2 + _N_JOINTS
    if any(map(bytes.strip, lines[line:])):
        raise FormatError(file, f"wanted the end after {n_frames} frames, got more", line + 1)


def _parse_count_line(lines: list[bytes], line: int, file: Path, what: str) -> int:
    if line >= len(lines) or (line == len(lines) - 1 and not lines[line].strip()):
        raise FormatError(file, f"wanted {what}, got the end of the file", line + 1)
    value = parse_count(lines[line])
    if value is None:
        raise FormatError(file, f"wanted {what}, got {quote(lines[line])}", line + 1)
    return value


def _body_id(lines: list[bytes], line: int, file: Path) -> int:
    """Check a body's info line and joint count, and that all its lines are there."""
    if line + 2 + _N_JOINTS > len(lines):
        reason = f"wanted a body of {2 + _N_JOINTS} lines, got the end of the file"
        raise FormatError(file, reason, line + 1)
    info = lines[line].split()
    body_id = parse_count(info[0]) if len(info) == _N_INFO else None
    if body_id is None:
        reason = f"wanted a body ID and {_N_INFO - 1} more fields, got {quote(info)}"
        raise FormatError(file, reason, line + 1)
    if _parse_count_line(lines, line + 1, file, "a joint count") != _N_JOINTS:
        raise FormatError(
            file, f"wanted {_N_JOINTS} joints, got {quote(lines[line + 1])}", line + 2
        )
    return body_id


def _poses(lines: list[bytes], starts: list[int], file: Path) -> Motion:
    """``(n, 25, 3)`` float32: the positions of the bodies whose info lines are ``starts``."""
    numbers = [i for start in starts for i in range(start + 2, start + 2 + _N_JOINTS)]
    rows = [lines[i].split() for i in numbers]
    unlike = b" ".join([lines[i] for i in numbers]).translate(None, _NUMERIC)
    if unlike or set(map(len, rows)) != {_N_FIELDS}:
        _check_joint_lines(rows, numbers, file)
    try:
        values = parse_floats(field for row in rows for field in row[:3])
    except ValueError:
        _check_joint_lines(rows, numbers, file)
        raise
    faulty = np.flatnonzero(~(np.abs(values) < MAX_COORDINATE))
    if len(faulty):
        row = rows[faulty[0] // 3]
        reason = f"wanted finite metres below {MAX_COORDINATE:g}, got {quote(row[:3])}"
        raise FormatError(file, reason, numbers[faulty[0] // 3] + 1)
    return values.astype(np.float32).reshape(-1, _N_JOINTS, 3)


def _check_joint_lines(rows: list[list[bytes]], numbers: list[int], file: Path) -> None:
    """Raise for the first faulty joint line, field by field."""
    for row, line in zip(rows, numbers, strict=True):
        if len(row) != _N_FIELDS:
            raise FormatError(
                file, f"wanted {_N_FIELDS} fields, got {len(row)}: {quote(row)}", line + 1
            )
        wrong = [field for field in row if not is_number(field)]
        if wrong:
            raise FormatError(file, f"wanted numbers, got {quote(wrong[0])}", line + 1)


@dataclass(frozen=True)
class Track:
    """One person in the frames in which they are detected.

    Parameters
    ----------
    frame : (n,) strictly ascending
    line : of the info line in each frame
    poses : (n, 25, 3) float32, metres
    """

    frame: NDArray[np.intp]
    line: NDArray[np.intp]
    poses: Motion

    @property
    def motion_variance(self) -> float:
        """Square metres: the variance over time of all coordinates, summed."""
        return float(self.poses.astype(np.float64).var(axis=0).sum())


def make_tracks(detections: Detections) -> list[Track]:
    """Group the detections by body ID, in order of appearance."""
    rows: dict[int, list[int]] = {}
    for row, body_id in enumerate(detections.body_id):
        rows.setdefault(body_id, []).append(row)
    line = np.array(detections.line, dtype=np.intp)
    return [
        Track(detections.frame[selected], line[selected], detections.poses[selected])
        for selected in rows.values()
    ]


def link_tracks(tracks: list[Track], max_gap: int, max_link_distance: float) -> list[Track]:
    """Link each track to the one that ended nearest to where it begins.

    Candidates ended at most ``max_gap`` frames earlier and at most ``max_link_distance`` metres
    away, measured at the base of the spine.
    """
    linked: list[Track] = []
    for track in tracks:
        distances = [_link_distance(person, track, max_gap) for person in linked]
        best = int(np.argmin(distances)) if distances else -1
        if best >= 0 and distances[best] <= max_link_distance:
            linked[best] = _concatenate(linked[best], track)
        else:
            linked.append(track)
    return linked


def select_two_most_active(
    tracks: list[Track], n_frames: int, min_visible_share: float, file: Path
) -> list[Track]:
    """Select the two that move most among those visible in ``min_visible_share`` of the frames.

    Raises
    ------
    FormatError
        If fewer than two are visible that long.
    """
    visible = [
        i for i, track in enumerate(tracks) if len(track.frame) >= min_visible_share * n_frames
    ]
    if len(visible) < 2:
        shares = ", ".join(f"{len(track.frame) / n_frames:.0%}" for track in tracks[:8])
        raise FormatError(
            file,
            f"wanted two bodies in at least {min_visible_share:.0%} of {n_frames} frames, "
            f"got {len(tracks)} in all (visible in {shares or 'none'})",
        )
    most_active = sorted(visible, key=lambda i: -tracks[i].motion_variance)[:2]
    return [tracks[i] for i in sorted(most_active)]


def common_frames(a: Track, b: Track, file: Path) -> NDArray[np.intp]:
    """List the frames in which both are present: from the later start to the earlier end.

    Raises
    ------
    FormatError
        If there are fewer than two.
    """
    first, last = max(a.frame[0], b.frame[0]), min(a.frame[-1], b.frame[-1])
    if last - first < 1:
        raise FormatError(file, "the two bodies are never visible together", int(b.line[0]))
    return np.arange(first, last + 1)


def interpolate_gaps(
    track: Track, frames: NDArray[np.intp], max_gap: int, file: Path
) -> tuple[Motion, int]:
    """Take the poses in ``frames``, linearly interpolated across short gaps.

    Returns
    -------
    ``(len(frames), 25, 3)`` float32 poses, and how many of them the file lacks

    Raises
    ------
    FormatError
        If one lies in a gap of more than ``max_gap`` frames.
    """
    right = np.searchsorted(track.frame, frames).clip(1)
    start, stop = track.frame[right - 1], track.frame[right]
    missing = ~np.isin(frames, track.frame)
    gap = np.where(missing, stop - start - 1, 0)
    if gap.max() > max_gap:
        at = int(gap.argmax())
        reason = f"a body is not visible for {gap[at]} frames; wanted at most {max_gap} (max_gap)"
        raise FormatError(file, reason, int(track.line[right[at] - 1]))
    weight = ((frames - start) / (stop - start)).astype(np.float32)[:, None, None]
    poses: Motion = (1 - weight) * track.poses[right - 1] + weight * track.poses[right]
    return poses, int(missing.sum())


def _link_distance(person: Track, track: Track, max_gap: int) -> float:
    """Metres from a track's end to another's start; inf where they cannot be linked."""
    if not 0 <= track.frame[0] - person.frame[-1] - 1 <= max_gap:
        return float("inf")
    root = NTU25.root
    return float(np.linalg.norm(track.poses[0, root] - person.poses[-1, root]))


def _concatenate(a: Track, b: Track) -> Track:
    return Track(
        frame=np.concatenate([a.frame, b.frame]),
        line=np.concatenate([a.line, b.line]),
        poses=np.concatenate([a.poses, b.poses]),
    )
