"""What the readers of numeric text share: bytes in, numbers out, every fault with its line."""

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pacmo_core.formats.raw import FormatError

# A kilometre: further than any capture volume, and nothing squared overflows in float32.
FARTHEST = 1e3

_NUMBER = re.compile(rb"\s*[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?\s*")
_NOT_FINITE = re.compile(rb"\s*[-+]?(nan|inf|infinity)\s*", re.IGNORECASE)


def read_bytes(file: Path) -> bytes:
    """Read a whole file.

    Raises
    ------
    FormatError
        If it cannot be read, or is empty.
    """
    try:
        data = file.read_bytes()
    except OSError as error:
        raise FormatError(file, f"cannot be read: {error.strerror}") from error
    if not data.strip():
        raise FormatError(file, "the file is empty")
    return data


def floats(fields: Iterable[bytes]) -> NDArray[np.float64]:
    """Parse numbers; ``nan`` and ``inf`` are numbers here, and not faults.

    Raises
    ------
    ValueError
        If a field is not a number.
    """
    return np.fromiter(map(float, fields), np.float64)


def is_number(field: bytes) -> bool:
    """Tell a decimal number (or a NaN or infinity) from other text, stricter than ``float``."""
    return bool(_NUMBER.fullmatch(field) or _NOT_FINITE.fullmatch(field))


def count(field: bytes) -> int | None:
    """Parse a non-negative integer that fits int64, or None."""
    field = field.strip()
    # 18 digits: below 2**63, and int() never meets a text long enough to be slow.
    return int(field) if field.isdigit() and len(field) <= 18 else None


def show(line: bytes | Sequence[bytes]) -> str:
    """Quote a line for a message: short and printable whatever it holds."""
    text = line if isinstance(line, bytes) else b" ".join(line[:20])
    return repr(text.strip()[:40])[1:] + ("..." if len(text.strip()) > 40 else "")
