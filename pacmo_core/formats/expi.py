"""ExPI: pairs of Lindy Hop dancers (Guo et al. 2022), ``acro<pair>/<action><k>/mocap_cleaned.tsv``.

Comma-separated despite the suffix. One header line, then one line per frame: 18 joints × xyz of the
leader, then of the follower, millimetres, at 25 fps. Which axis is up is not in the file: it is a
setting; z, usual for optical capture, is an assumption.
"""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.skeleton import EXPI18
from pacmo_core.formats.base import (
    FormatError,
    Person,
    RawSequence,
    Reading,
    check_fps,
    check_up,
    check_work,
    pair_people,
    to_y_up,
)
from pacmo_core.formats.pairing import matching_files, unpaired_sequence
from pacmo_core.formats.tables import parse_rows, read_lines, sequence_name

_COLUMNS = 2 * 18 * 3
_PATH = r"(?:.*/)?(?P<pair>acro\d+)/(?P<action>.+?)\d*/mocap_cleaned\.tsv"
_MILLIMETRE = 0.001


@dataclass(frozen=True, kw_only=True)
class Expi:
    """ExPI; person a leads.

    Parameters
    ----------
    fps : frames a second, 25 as published
    up : the axis that is up, ``y`` or ``z``
    """

    fps: float
    up: str

    def __post_init__(self) -> None:
        check_fps(self.fps)
        check_up(self.up)

    def find(self, root: Path) -> list[RawSequence]:
        """List every ``.tsv`` file."""
        return [_sequence(root, file) for file in matching_files(root, r".*\.tsv")]

    def read(self, sequence: RawSequence) -> Reading:
        """Read both people from one file.

        Raises
        ------
        FormatError
            If the header is missing or a row is not 108 numbers.
        """
        file = sequence.files[0]
        table = _read_table(file).reshape(-1, 2, 18, 3) * _MILLIMETRE
        positions = to_y_up(table, self.up)
        return pair_people([Person(file, EXPI18, positions[:, who], self.fps) for who in (0, 1)])


def _sequence(root: Path, file: Path) -> RawSequence:
    path = file.relative_to(root).as_posix()
    match = re.fullmatch(_PATH, path)
    if match is None:
        return unpaired_sequence(root, file)
    folder = path.rpartition("/")[0]
    return RawSequence(
        name=sequence_name(folder),
        files=(file,),
        action=match["action"],
        subjects=(f"{match['pair']}-leader", f"{match['pair']}-follower"),
        recording="/".join(folder.split("/")[-2:]),
    )


def _read_table(file: Path) -> NDArray[np.float64]:
    lines = read_lines(file)
    header = lines[0].split(",")
    if len(header) != _COLUMNS or not re.search("[A-Za-z]", lines[0]):
        reason = f"wanted a header of {_COLUMNS} names; got {len(header)} words"
        raise FormatError(file, f"{reason}: {lines[0][:40]!r}", 1)
    rows = [(text, line) for line, text in enumerate(lines[1:], 2) if text.strip()]
    check_work(file, len(rows), 18)
    texts, numbers = [text for text, _ in rows], [line for _, line in rows]
    return parse_rows(file, texts, numbers, width=_COLUMNS, delimiter=",")
