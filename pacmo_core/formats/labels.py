"""Actions, people and recordings of captures, stated in a table beside them: ``captures.csv``.

It lies in the folder of the captures. A line names a file and states what its name does not say:

    file,action,person_a,person_b,recording
    hug01_A.bvh,hug,anna,ben,monday

Further columns are ignored. An empty cell states nothing.
"""

import csv
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from pacmo_core.formats.base import Format, FormatError, RawSequence
from pacmo_core.formats.tables import read_lines

CAPTURES_CSV = "captures.csv"
COLUMNS = ("file", "action", "person_a", "person_b")
RECORDING = "recording"  # a column that may be missing


@dataclass(frozen=True)
class _Row:
    line: int
    file: str
    action: str
    people: tuple[str, str]
    recording: str


def find_sequences(form: Format, root: Path) -> list[RawSequence]:
    """List the sequences of a folder, with what its ``captures.csv`` states, sorted by name.

    Raises
    ------
    FormatError
        If a line of ``captures.csv`` is broken, names a file of no sequence, or two name one.
    """
    sequences = sorted(form.find(root), key=lambda sequence: sequence.name)
    table = root / CAPTURES_CSV
    if not table.is_file():
        return sequences
    rows_of_path: dict[str, list[int]] = {}
    for number, sequence in enumerate(sequences):
        for file in sequence.files:
            path = file.relative_to(root).as_posix()
            rows_of_path.setdefault(path, []).append(number)
    line_of_sequence: dict[int, int] = {}
    for row in _read_rows(table):
        if row.file not in rows_of_path:
            raise FormatError(table, f"{row.file!r} is the file of no capture", row.line)
        for number in rows_of_path[row.file]:
            if number in line_of_sequence:
                reason = f"{row.file!r} is of the capture of line {line_of_sequence[number]}"
                raise FormatError(table, reason, row.line)
            line_of_sequence[number] = row.line
            sequences[number] = _labelled(sequences[number], row)
    return sequences


def _labelled(sequence: RawSequence, row: _Row) -> RawSequence:
    (a, b), (old_a, old_b) = row.people, sequence.subjects
    return replace(
        sequence,
        action=row.action or sequence.action,
        subjects=(a or old_a, b or old_b),
        recording=row.recording or sequence.recording,
    )


def _read_rows(table: Path) -> Iterator[_Row]:
    header: list[str] = []
    for line, text in enumerate(read_lines(table), start=1):
        if not text.strip(" ,\t"):
            continue
        words = _words(table, text, line)
        if not header:
            header = _checked_header(table, words, line)
            continue
        if len(words) != len(header):
            raise FormatError(table, f"wanted {len(header)} cells; got {len(words)}", line)
        cells = dict(zip(header, words, strict=True))
        if not cells["file"]:
            raise FormatError(table, "no file", line)
        people = (cells["person_a"], cells["person_b"])
        yield _Row(line, cells["file"], cells["action"], people, cells.get(RECORDING, ""))


def _words(table: Path, text: str, line: int) -> list[str]:
    try:
        (words,) = csv.reader([text], strict=True)
    except csv.Error as error:
        raise FormatError(table, f"no comma-separated values: {error}", line) from error
    words = [word.strip() for word in words]
    unprintable = [word for word in words if not word.isprintable()]
    if unprintable:
        raise FormatError(table, f"wanted printable text; got {unprintable[0][:40]!r}", line)
    return words


def _checked_header(table: Path, words: list[str], line: int) -> list[str]:
    missing = [name for name in COLUMNS if name not in words]
    if missing:
        reason = f"wanted the columns {', '.join(COLUMNS)}; {', '.join(missing)} missing"
        raise FormatError(table, reason, line)
    twice = [name for name in (*COLUMNS, RECORDING) if words.count(name) > 1]
    if twice:
        raise FormatError(table, f"the column {twice[0]} comes twice", line)
    return words
