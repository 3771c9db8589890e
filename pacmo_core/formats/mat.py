"""Plain numeric variables of MATLAB files (level 5: versions 5 to 7.2), and nothing else.

Follows "MAT-File Format" (The MathWorks). Unlike scipy.io.loadmat, which builds Python objects
from cells and structures and can crash the process on damaged files, this reads real arrays only,
checks every length before it uses it, and never allocates more memory than stated.
"""

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from math import prod
from os import SEEK_END
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.limits import MAX_NUMBERS
from pacmo_core.formats.base import FormatError, check_file
from pacmo_core.formats.tables import to_float64

MAX_VARIABLES = 4096  # in a file
_MATRIX, _COMPRESSED = 14, 15
_HEAD = 4096  # bytes that hold a variable's class, shape and name
_DTYPES = {
    1: "i1",
    2: "u1",
    3: "i2",
    4: "u2",
    5: "i4",
    6: "u4",
    7: "f4",
    9: "f8",
    12: "i8",
    13: "u8",
}
_CLASSES = {1: "cell", 2: "struct", 3: "object", 4: "char", 5: "sparse", 16: "function"}
_COMPLEX = 0x0800


class _BrokenError(ValueError):
    """A damaged file; the message states what was expected."""


@dataclass(frozen=True)
class _Variable:
    name: str
    shape: tuple[int, ...]
    order: str  # byte order, < or >
    numbers: int  # where they start in the unpacked variable


@dataclass(frozen=True)
class _Entry:
    """A variable's place in the file: bytes ``start`` to ``start + size``."""

    variable: _Variable
    kind: int
    start: int
    size: int


def list_variables(file: Path) -> list[str]:
    """List the file's variables by name, without reading their numbers.

    Raises
    ------
    FormatError
        If the file is no MATLAB file of level 5, or a variable is not plain real numbers.
    """
    return list(_directory(file))


def read_variable(file: Path, name: str) -> NDArray[np.float64]:
    """Read one variable as float64; only its own bytes are read.

    Raises
    ------
    FormatError
        If it is not there, or not all finite real numbers.
    """
    entries = _directory(file)
    if name not in entries:
        raise FormatError(file, f"wanted the variable {name!r}; it has {', '.join(entries)}")
    entry = entries[name]
    variable, count = entry.variable, prod(entry.variable.shape)
    try:
        with file.open("rb") as stream:
            matrix = _unpacked(stream, entry.kind, entry.start, entry.size, 8 * count + _HEAD)
        code, payload, _ = _element(matrix, variable.numbers, variable.order)
    except _BrokenError as error:
        raise FormatError(file, f"{name}: {error}") from error
    if code not in _DTYPES or len(payload) != count * np.dtype(_DTYPES[code]).itemsize:
        raise FormatError(
            file, f"{name}: {len(payload)} bytes of type {code} are no {variable.shape}"
        )
    flat = np.frombuffer(payload, dtype=variable.order + _DTYPES[code])
    return to_float64(file, flat.reshape(variable.shape, order="F"))


def _directory(file: Path) -> dict[str, _Entry]:
    check_file(file)
    facts = file.stat()
    return _read_directory(file, (facts.st_ino, facts.st_size, facts.st_mtime_ns))


# Every clip of a dance is a variable of the same two files: their directories are read once.
@lru_cache(maxsize=16)
def _read_directory(file: Path, _version: tuple[int, int, int]) -> dict[str, _Entry]:
    entries: dict[str, _Entry] = {}
    try:
        with file.open("rb") as stream:
            for entry in _entries(stream):
                _check_new(entry.variable.name, entries)
                entries[entry.variable.name] = entry
    except _BrokenError as error:
        raise FormatError(file, str(error)) from error
    except OSError as error:
        raise FormatError(file, f"cannot be read: {error.strerror}") from error
    return entries


def _check_new(name: str, entries: dict[str, _Entry]) -> None:
    if name in entries:
        raise _BrokenError(f"the variable {name!r} comes twice")
    if len(entries) == MAX_VARIABLES:
        raise _BrokenError(f"wanted at most {MAX_VARIABLES} variables; got more")


def _entries(stream: BinaryIO) -> Iterator[_Entry]:
    """Yield each packed or plain variable."""
    head = stream.read(128)
    order = {b"IM": "<", b"MI": ">"}.get(head[126:128])
    if order is None:
        raise _BrokenError("no MATLAB file of level 5 (versions 5 to 7.2)")
    end, offset = stream.seek(0, SEEK_END), 128
    while offset < end:
        if end - offset < 8:
            raise _BrokenError("the file ends inside a variable")
        stream.seek(offset)
        kind, size = struct.unpack(order + "II", stream.read(8))
        offset += 8
        if kind not in (_MATRIX, _COMPRESSED) or size > end - offset:
            raise _BrokenError(f"wanted a variable; got {size} bytes of type {kind}")
        matrix = _unpacked(stream, kind, offset, size, _HEAD)
        yield _Entry(_variable(matrix, order), kind, offset, size)
        offset += size


def _unpacked(stream: BinaryIO, kind: int, start: int, size: int, limit: int) -> memoryview:
    """Give the first ``limit`` bytes of a matrix, inflated if need be."""
    stream.seek(start)
    if kind == _MATRIX:
        return memoryview(stream.read(min(size, limit)))
    # Deflated data are never much longer than their content.
    packed = stream.read(min(size, limit + _HEAD))
    try:
        # The inflated bytes open with the matrix' own tag.
        return memoryview(zlib.decompressobj().decompress(packed, limit + 8))[8:]
    except zlib.error as error:
        raise _BrokenError(str(error)) from error


def _element(matrix: memoryview, offset: int, order: str) -> tuple[int, memoryview, int]:
    """Read one part of a matrix: its type, its bytes, and where the next begins."""
    if len(matrix) - offset < 8:
        raise _BrokenError("a variable ends early")
    code, size = struct.unpack_from(order + "II", matrix, offset)
    start, step = offset + 8, -(-size // 8) * 8
    if code >> 16:  # four bytes or fewer share the tag
        code, size, start, step = code & 0xFFFF, code >> 16, offset + 4, 4
    payload = matrix[start : start + size]
    if len(payload) != size or size > step:
        raise _BrokenError("a variable ends early")
    return code, payload, start + step


def _variable(head: memoryview, order: str) -> _Variable:
    _, flags, offset = _element(head, 0, order)
    _, sizes, offset = _element(head, offset, order)
    _, letters, offset = _element(head, offset, order)
    if len(flags) != 8 or len(sizes) % 4 or not 8 <= len(sizes) <= 128:
        raise _BrokenError("a variable has no class or shape")
    (word,) = struct.unpack_from(order + "I", flags)
    shape = struct.unpack(f"{order}{len(sizes) // 4}i", sizes)
    name = bytes(letters).decode("ascii", "replace")
    if not 6 <= word & 0xFF <= 15 or word & _COMPLEX or not name:
        what = "complex" if word & _COMPLEX else _CLASSES.get(word & 0xFF, "thing of its own")
        raise _BrokenError(f"{name}: wanted plain real numbers; got a {what}")
    if min(shape) < 0 or prod(shape) > MAX_NUMBERS:
        raise _BrokenError(f"{name}: {shape} is more than {MAX_NUMBERS} numbers")
    return _Variable(name, shape, order, offset)
