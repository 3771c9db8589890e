"""From bodies seen frame by frame to two people followed throughout.

The recorder gives a body a new number whenever it loses it and finds it again, and now and then
sees a body in the furniture. So: sightings of one number are a track; a track that begins where
another has just ended is the same person; of the people who stay, the two who move most act.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.interaction import Motion
from pacmo_core.data.skeleton import NTU25
from pacmo_core.formats.ntu_text import Sightings
from pacmo_core.formats.raw import FormatError


@dataclass(frozen=True)
class Track:
    """One person in the frames in which they are seen.

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
    def spread(self) -> float:
        """Square metres: the variance over time of all coordinates, summed."""
        return float(self.poses.astype(np.float64).var(axis=0).sum())


def tracks(seen: Sightings) -> list[Track]:
    """Gather the sightings of each body number, in order of appearance."""
    rows: dict[int, list[int]] = {}
    for row, body_id in enumerate(seen.body_id):
        rows.setdefault(body_id, []).append(row)
    line = np.array(seen.line, dtype=np.intp)
    return [Track(seen.frame[own], line[own], seen.poses[own]) for own in rows.values()]


def stitch(found: list[Track], max_gap: int, reach: float) -> list[Track]:
    """Join a track to the one that ended nearest to where it begins.

    Only one that ended before, at most ``max_gap`` unseen frames earlier and at most ``reach``
    metres away, measured at the base of the spine, can be the same person.
    """
    people: list[Track] = []
    for track in found:
        far = [_distance(person, track, max_gap) for person in people]
        best = int(np.argmin(far)) if far else -1
        if best >= 0 and far[best] <= reach:
            people[best] = _join(people[best], track)
        else:
            people.append(track)
    return people


def two_who_act(people: list[Track], n_frames: int, min_share: float, file: Path) -> list[Track]:
    """Choose the two who move most among those seen in ``min_share`` of the frames.

    Raises
    ------
    FormatError
        If fewer than two stay that long.
    """
    stay = [i for i, track in enumerate(people) if len(track.frame) >= min_share * n_frames]
    if len(stay) < 2:
        shares = ", ".join(f"{len(track.frame) / n_frames:.0%}" for track in people[:8])
        raise FormatError(
            file,
            f"wanted two bodies in at least {min_share:.0%} of {n_frames} frames, "
            f"got {len(people)} in all (seen in {shares or 'none'})",
        )
    movers = sorted(stay, key=lambda i: -people[i].spread)[:2]
    return [people[i] for i in sorted(movers)]


def together(a: Track, b: Track, file: Path) -> NDArray[np.intp]:
    """List the frames from the later arrival to the earlier departure.

    Raises
    ------
    FormatError
        If there are fewer than two.
    """
    first, last = max(a.frame[0], b.frame[0]), min(a.frame[-1], b.frame[-1])
    if last - first < 1:
        raise FormatError(file, "the two bodies are never seen together", int(b.line[0]))
    return np.arange(first, last + 1)


def fill(track: Track, wanted: NDArray[np.intp], max_gap: int, file: Path) -> tuple[Motion, int]:
    """Take the poses in the frames ``wanted``, with straight lines across short gaps.

    Returns
    -------
    ``(len(wanted), 25, 3)`` float32 poses, and how many of them the file lacks

    Raises
    ------
    FormatError
        If one lies in a gap of more than ``max_gap`` frames.
    """
    right = np.searchsorted(track.frame, wanted).clip(1)
    start, stop = track.frame[right - 1], track.frame[right]
    lacking = ~np.isin(wanted, track.frame)
    gap = np.where(lacking, stop - start - 1, 0)
    if gap.max() > max_gap:
        at = int(gap.argmax())
        reason = f"a body is then not seen for {gap[at]} frames; at most {max_gap} can be filled"
        raise FormatError(file, reason, int(track.line[right[at] - 1]))
    weight = ((wanted - start) / (stop - start)).astype(np.float32)[:, None, None]
    poses: Motion = (1 - weight) * track.poses[right - 1] + weight * track.poses[right]
    return poses, int(lacking.sum())


def _distance(person: Track, track: Track, max_gap: int) -> float:
    """Metres from where a person was last seen to where a track begins; inf if another's."""
    if not 0 <= track.frame[0] - person.frame[-1] - 1 <= max_gap:
        return float("inf")
    root = NTU25.root
    return float(np.linalg.norm(track.poses[0, root] - person.poses[-1, root]))


def _join(a: Track, b: Track) -> Track:
    return Track(
        frame=np.concatenate([a.frame, b.frame]),
        line=np.concatenate([a.line, b.line]),
        poses=np.concatenate([a.poses, b.poses]),
    )
