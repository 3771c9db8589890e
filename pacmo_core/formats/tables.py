"""Numeric files: text as bytes, lines and tables of numbers, and NPZ; errors name file and line."""

import lzma
import re
import tokenize
import warnings
import zipfile
import zlib
from collections.abc import Iterable, Sequence
from math import prod
from pathlib import Path
from typing import IO

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from pacmo_core.data.limits import MAX_LINE_BYTES, MAX_LINES, MAX_NUMBERS
from pacmo_core.formats.base import FormatError, read_content

# A kilometre: larger than any capture volume, and its square is finite in float32.
MAX_COORDINATE = 1e3

# Exceptions of NumPy's reader on damaged headers, which it parses as Python text.
NPY_ERRORS = (
    ValueError,
    TypeError,
    SyntaxError,
    ArithmeticError,
    EOFError,
    OSError,
    MemoryError,
    RecursionError,
    tokenize.TokenError,
    UserWarning,
)

MAX_ARRAY_BYTES = 200_000_000  # of an unpacked array
_ARRAY_KINDS = "iufUS"  # integers, real numbers, text
_ZIP_ERRORS = (
    zipfile.BadZipFile,
    zlib.error,
    lzma.LZMAError,
    NotImplementedError,  # a compression that Python does not know
    RuntimeError,  # an encrypted file
)

_NUMBER = re.compile(rb"\s*[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?\s*")
_NOT_FINITE = re.compile(rb"\s*[-+]?(nan|inf|infinity)\s*", re.IGNORECASE)


def read_bytes(file: Path) -> bytes:
    """Read a whole file.

    Raises
    ------
    FormatError
        If it cannot be read, is empty, or is larger than ``data.limits`` allows.
    """
    data = read_content(file)
    check_lines(file, data)
    if not data.strip():
        raise FormatError(file, "the file is empty")
    return data


def check_lines(file: Path, content: bytes) -> None:
    """Raise FormatError if a text has more or longer lines than ``data.limits`` allows.

    A line becomes words, each of which takes many times its bytes.
    """
    n_lines = max(content.count(b"\n"), content.count(b"\r")) + 1
    if n_lines > MAX_LINES:
        raise FormatError(file, f"wanted at most {MAX_LINES} lines; got {n_lines}")
    if len(content) <= MAX_LINE_BYTES:
        return
    lines = content.replace(b"\r\n", b"\n").replace(b"\r", b"\n").split(b"\n")
    for number, line in enumerate(lines, start=1):
        if len(line) > MAX_LINE_BYTES:
            reason = f"wanted lines of at most {MAX_LINE_BYTES} bytes; got {len(line)}"
            raise FormatError(file, reason, number)


def parse_floats(fields: Iterable[bytes]) -> NDArray[np.float64]:
    """Parse numbers; ``nan`` and ``inf`` are numbers here, and not faults.

    Raises
    ------
    ValueError
        If a field is not a number.
    """
    return np.fromiter(map(float, fields), np.float64)


def is_number(field: bytes) -> bool:
    """Whether text is a decimal number, NaN or infinity; stricter than ``float``."""
    return bool(_NUMBER.fullmatch(field) or _NOT_FINITE.fullmatch(field))


def parse_count(field: bytes) -> int | None:
    """Parse a non-negative integer that fits int64, or None."""
    field = field.strip()
    # 18 digits: below 2**63, and int() never meets a text long enough to be slow.
    return int(field) if field.isdigit() and len(field) <= 18 else None


def quote(line: bytes | Sequence[bytes]) -> str:
    """Quote a line for a message: short and printable."""
    text = line if isinstance(line, bytes) else b" ".join(line[:20])
    return repr(text.strip()[:40])[1:] + ("..." if len(text.strip()) > 40 else "")


def short_reason(error: BaseException) -> str:
    """Return the text of another library's error: short, printable and on one line."""
    text = " ".join(str(error).split())[:200] or type(error).__name__
    return "".join(letter if letter.isprintable() else "?" for letter in text)


# No length, angle or index of a capture is larger in any unit; the limit keeps float32 finite.
MAX_NUMBER = 1e9


def read_lines(file: Path) -> list[str]:
    """Read UTF-8 text as lines without their ends (LF, CRLF or CR).

    Raises
    ------
    FormatError
        If the file cannot be read, is empty, is not UTF-8, or is larger than ``data.limits``
        allows.
    """
    content = read_content(file)
    check_lines(file, content)
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
    """Parse one finite number; raise with the word and its line."""
    try:
        number = float(word)
    except ValueError:
        raise FormatError(file, f"wanted a number; got {word[:40]!r}", line) from None
    # float() also takes underscores and the digits of other scripts, which no capture holds.
    if "_" in word or not word.isascii() or not abs(number) <= MAX_NUMBER:
        raise FormatError(file, f"wanted a number up to {MAX_NUMBER:g}; got {word[:40]!r}", line)
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
    delimiter : the separator; None for white space

    Returns
    -------
    ``(len(rows), width)`` float64, finite

    Raises
    ------
    FormatError
        If a row has more or fewer numbers, a word is no finite number, or there are more than
        ``MAX_NUMBERS``.
    """
    if len(rows) * width > MAX_NUMBERS:
        raise FormatError(file, f"wanted at most {MAX_NUMBERS} numbers; got {len(rows) * width}")
    if not rows or not width:
        return np.zeros((len(rows), width))
    try:
        table = np.loadtxt(rows, delimiter=delimiter, comments=None, ndmin=2, dtype=np.float64)
    except ValueError as error:
        raise _first_fault(file, rows, lines, width=width, delimiter=delimiter) from error
    if table.shape != (len(rows), width) or not (np.abs(table) <= MAX_NUMBER).all():
        raise _first_fault(file, rows, lines, width=width, delimiter=delimiter)
    return table


def to_float64(file: Path, table: NDArray[np.generic]) -> NDArray[np.float64]:
    """Convert real numbers to float64.

    Raises
    ------
    FormatError
        If one is not finite, or larger than ``MAX_NUMBER``.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        numbers: NDArray[np.float64] = table.astype(np.float64)
    wrong = np.argwhere(~(np.abs(numbers) <= MAX_NUMBER))
    if len(wrong):
        position = tuple(int(i) for i in wrong[0])
        raise FormatError(
            file, f"wanted numbers up to {MAX_NUMBER:g}; {position} has {numbers[position]}"
        )
    return numbers


def sequence_name(path: str) -> str:
    """Replace the characters that a sequence's name may not hold: they become ``-u<code>-``."""
    return re.sub(r"[^A-Za-z0-9_./-]", lambda match: f"-u{ord(match[0]):x}-", path)


def _first_fault(
    file: Path, rows: Sequence[str], lines: Sequence[int], *, width: int, delimiter: str | None
) -> FormatError:
    """Find the first faulty row (slow, only after an error)."""
    try:
        for row, line in zip(rows, lines, strict=True):
            words = row.split(delimiter)
            if len(words) != width:
                return FormatError(file, f"wanted {width} numbers; got {len(words)}", line)
            for word in words:
                parse_number(file, line, word.strip())
    except FormatError as error:
        return error
    return FormatError(file, f"wanted {len(rows)} rows of {width} numbers", lines[0])


def npz_arrays(file: Path, names: Sequence[str]) -> dict[str, NDArray[np.generic]]:
    """Read the arrays of these names that an NPZ file has; others are not opened.

    Numbers and text alone. Unlike ``numpy.load``, which allocates what an array's header says, this
    refuses a header of more than ``MAX_ARRAY_BYTES`` before it unpacks anything.

    Raises
    ------
    FormatError
        If the file is no NPZ, or one of these arrays is damaged, too large or of Python objects.
    """
    try:
        with zipfile.ZipFile(file) as archive:
            members = set(archive.namelist())
            present = [name for name in names if f"{name}.npy" in members]
            return {name: _read_array(file, archive, name) for name in present}
    except (*_ZIP_ERRORS, OSError) as error:
        raise FormatError(file, f"no NPZ file: {short_reason(error)}") from error


def _read_array(file: Path, archive: zipfile.ZipFile, name: str) -> NDArray[np.generic]:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            with archive.open(f"{name}.npy") as stream:
                shape, dtype = _array_header(stream)
            _check_array(file, name, shape, dtype)
            with archive.open(f"{name}.npy") as stream:
                array: NDArray[np.generic] = npy.read_array(stream, allow_pickle=False)
    except FormatError:
        raise
    except (*_ZIP_ERRORS, *NPY_ERRORS) as error:
        raise FormatError(file, f"{name}: no array: {short_reason(error)}") from error
    return array


def _array_header(stream: IO[bytes]) -> tuple[tuple[int, ...], np.dtype[np.generic]]:
    version = npy.read_magic(stream)
    if version not in ((1, 0), (2, 0)):
        raise ValueError(f"version {version} of the format, wanted 1.0 or 2.0")
    read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    shape, _, dtype = read(stream)
    return shape, dtype


def _check_array(
    file: Path, name: str, shape: tuple[int, ...], dtype: np.dtype[np.generic]
) -> None:
    if dtype.kind not in _ARRAY_KINDS:
        what = "Python objects, which are pickled" if dtype.hasobject else str(dtype)
        raise FormatError(file, f"{name}: wanted plain numbers or text; got {what}")
    if min(shape, default=0) < 0 or prod(shape) * dtype.itemsize > MAX_ARRAY_BYTES:
        raise FormatError(file, f"{name}: {shape} of {dtype} is more than {MAX_ARRAY_BYTES} bytes")
