"""Text files as lines and tables of numbers, every fault told with its file and line."""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pacmo_core.formats.raw import FormatError

# No length, angle or index of a capture is larger in any unit; the limit keeps float32 finite.
LARGEST = 1e9


def read_lines(file: Path) -> list[str]:
    """Read UTF-8 text as lines without their ends (LF, CRLF or CR).

    Raises
    ------
    FormatError
        If the file cannot be opened, is empty or is not UTF-8.
    """
    try:
        content = file.read_bytes()
    except OSError as error:
        raise FormatError(file, f"cannot be opened: {error.strerror}") from error
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        byte = content[error.start]
        raise FormatError(file, f"wanted UTF-8 text; got the byte 0x{byte:02x}", line) from error
    if not text.strip():
        raise FormatError(file, "the file is empty")
    # Not splitlines: it would break at form feeds and separators, and line numbers would be wrong.
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


def parse_number(file: Path, line: int, word: str) -> float:
    """Read one finite number, or say which word on which line is none."""
    try:
        number = float(word)
    except ValueError:
        raise FormatError(file, f"wanted a number; got {word[:40]!r}", line) from None
    # float() also takes digits with underscores, which no capture holds.
    if "_" in word or not abs(number) <= LARGEST:
        raise FormatError(file, f"wanted a number up to {LARGEST:g}; got {word[:40]!r}", line)
    return number


def parse_rows(
    file: Path,
    rows: Sequence[str],
    lines: Sequence[int],
    *,
    width: int,
    delimiter: str | None,
) -> NDArray[np.float64]:
    """Read a table of numbers.

    Parameters
    ----------
    file : for the message
    rows : one text a row, none blank
    lines : the 1-based line of each row, for the message
    width : numbers a row
    delimiter : what stands between numbers; None for white space

    Returns
    -------
    ``(len(rows), width)`` float64, finite

    Raises
    ------
    FormatError
        If a row has more or fewer numbers, or a word is no finite number.
    """
    if not rows or not width:
        return np.zeros((len(rows), width))
    try:
        table = np.loadtxt(rows, delimiter=delimiter, comments=None, ndmin=2, dtype=np.float64)
    except ValueError as error:
        raise _fault(file, rows, lines, width=width, delimiter=delimiter) from error
    if table.shape != (len(rows), width) or not (np.abs(table) <= LARGEST).all():
        raise _fault(file, rows, lines, width=width, delimiter=delimiter)
    return table


def bounded(file: Path, table: NDArray[np.generic]) -> NDArray[np.float64]:
    """Turn real numbers into float64.

    Raises
    ------
    FormatError
        If one is not finite, or larger than any of a capture.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        numbers: NDArray[np.float64] = table.astype(np.float64)
    wrong = np.argwhere(~(np.abs(numbers) <= LARGEST))
    if len(wrong):
        place = tuple(int(i) for i in wrong[0])
        raise FormatError(file, f"wanted numbers up to {LARGEST:g}; {place} has {numbers[place]}")
    return numbers


def sequence_name(path: str) -> str:
    """Spell a path with the letters a sequence's name may hold: others become ``-u<code>-``."""
    return re.sub(r"[^A-Za-z0-9_./-]", lambda match: f"-u{ord(match[0]):x}-", path)


def _fault(
    file: Path, rows: Sequence[str], lines: Sequence[int], *, width: int, delimiter: str | None
) -> FormatError:
    """Find the first row at fault: slow, and only needed once."""
    try:
        for row, line in zip(rows, lines, strict=True):
            words = row.split(delimiter)
            if len(words) != width:
                return FormatError(file, f"wanted {width} numbers; got {len(words)}", line)
            for word in words:
                parse_number(file, line, word.strip())
    except FormatError as fault:
        return fault
    return FormatError(file, f"wanted {len(rows)} rows of {width} numbers", lines[0])
