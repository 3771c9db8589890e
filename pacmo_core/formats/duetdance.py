"""DuetDance: two dancers' joints, estimated from videos with LCR-Net (Kundu et al. 2020).

Two layouts. MATLAB: ``male/<dance>.mat`` and ``female/<dance>.mat``, with one variable per clip,
``<video>_<part>``, ``(T, 15, 3)``. Text, as converted by the authors of
InterFormer: ``skeleton_pos.txt``, one line per frame: an index, then 15 joints × xyz. Their
folders hold one dancer only; two are taken from ``male/<dance>/<clip>/skeleton_pos.txt`` with
``female/...``, or from ``<dance>/<clip>/skeleton_A.txt`` with ``skeleton_B.txt``.

Metres, y up, z into depth; read as right-handed, knees bend forwards and odd joints (from 1) are
the right ones. No file states its rate: it is a setting; 25 fps, usual for video, is an assumption.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.skeleton import DUET15
from pacmo_core.formats.base import (
    FormatError,
    Person,
    RawSequence,
    Reading,
    check_fps,
    check_work,
    pair_people,
)
from pacmo_core.formats.mat import list_variables, read_variable
from pacmo_core.formats.pairing import PairRule, matching_files, pair_files, unpaired_sequence
from pacmo_core.formats.tables import parse_rows, read_lines, sequence_name

DANCES = {"01": "cha-cha", "02": "jive", "03": "rumba", "04": "salsa", "05": "samba"}


def dance_name(folder: str) -> str:
    """Return the dance of a numbered folder; other names are returned unchanged."""
    return DANCES.get(folder, folder)


_CLIP = r"(?P<dance>[^/]+)/(?P<clip>[^/]+)"
_RULES = tuple(
    PairRule(
        pattern=rf"(?P<folder>(?:.*/)?){place}",
        persons=persons,
        name="{folder}{dance}/{clip}",
        recording="{dance}/{clip}",
        action="{dance}",
        subjects=("", ""),
        label=dance_name,
    )
    for place, persons in (
        (rf"(?P<person>male|female)/{_CLIP}/skeleton_pos\.txt", ("male", "female")),
        (rf"{_CLIP}/skeleton_(?P<person>A|B)\.txt", ("A", "B")),
    )
)


@dataclass(frozen=True, kw_only=True)
class DuetDance:
    """DuetDance in either layout; person a is the man.

    Parameters
    ----------
    fps : frames a second; the files do not state it
    """

    fps: float

    def __post_init__(self) -> None:
        check_fps(self.fps)

    def find(self, root: Path) -> list[RawSequence]:
        """List the clips of two dancers, and every file or clip without the other's."""
        result = pair_files(root, r"skeleton_.*\.txt", _RULES)
        for file in matching_files(root, r".*\.mat"):
            result += _mat_clips(root, file)
        return sorted(result, key=lambda sequence: sequence.name)

    def read(self, sequence: RawSequence) -> Reading:
        """Read both dancers.

        Raises
        ------
        FormatError
            If a file is broken (said first), the second is missing, or the two do not match.
        """
        clip = sequence.name.rpartition("/")[2]
        return pair_people(
            [Person(file, DUET15, _positions(file, clip), self.fps) for file in sequence.files]
        )


def _mat_clips(root: Path, file: Path) -> list[RawSequence]:
    """List the clips of one dancer's file: with the man's those that both have, else the rest."""
    sex, dance = file.parent.name, file.stem
    if not file.is_file():
        return [unpaired_sequence(root, file)]
    partner = file.parent.parent / {"male": "female"}.get(sex, "male") / file.name
    ours = _variable_names(file)
    if sex not in ("male", "female") or not partner.is_file() or not ours:
        return [unpaired_sequence(root, file)]
    theirs = set(_variable_names(partner))
    folder = file.parent.parent.relative_to(root).as_posix()
    position = dance if folder == "." else f"{folder}/{dance}"
    pairs = [
        _clip_sequence(position, dance, name, (file, partner)) for name in ours if name in theirs
    ]
    alone = [
        _clip_sequence(f"{position}-{sex}", dance, name, (file,))
        for name in ours
        if name not in theirs
    ]
    return pairs + alone if sex == "male" else alone


def _clip_sequence(place: str, dance: str, name: str, files: tuple[Path, ...]) -> RawSequence:
    return RawSequence(
        name=sequence_name(f"{place}/{name}"),
        files=files,
        action=dance_name(dance),
        recording=f"{dance}/{name.rpartition('_')[0] or name}",
    )


def _variable_names(file: Path) -> list[str]:
    """List a file's variables; a damaged file has none, and ``read`` gives the reason."""
    try:
        return list_variables(file)
    except FormatError:
        return []


def _positions(file: Path, clip: str) -> NDArray[np.float64]:
    """``(T, 15, 3)`` metres."""
    if file.suffix.lower() != ".mat":
        return _read_text(file)
    known = list_variables(file)
    names = [clip] if clip in known else [name for name in known if sequence_name(name) == clip]
    if not names:
        reason = f"no second person: {clip!r} is no variable of a male/ and a female/ file"
        raise FormatError(file, reason)
    table = read_variable(file, names[0])
    if table.ndim != 3 or table.shape[1:] != (15, 3):
        raise FormatError(file, f"{clip}: wanted (T, 15, 3); got {table.shape}")
    return table


def _read_text(file: Path) -> NDArray[np.float64]:
    numbered = [(text, line) for line, text in enumerate(read_lines(file), 1) if text.strip()]
    rows, lines = zip(*numbered, strict=True)
    check_work(file, len(rows), len(DUET15.joints))
    table = parse_rows(file, rows, lines, width=46, delimiter=",")
    gaps = np.flatnonzero(np.diff(table[:, 0]) != 1)
    if len(gaps):
        here, after = table[gaps[0], 0], table[gaps[0] + 1, 0]
        raise FormatError(file, f"frame {after:g} follows frame {here:g}", lines[gaps[0] + 1])
    return table[:, 1:].reshape(-1, 15, 3)
