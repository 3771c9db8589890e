"""Plain numeric variables of MATLAB files (version 4 to 7.2), and nothing else.

SciPy's reader builds Python objects out of cells, structures and functions; a capture needs none,
so any file that holds one is refused before its contents are read.
"""

import struct
import warnings
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat, matlab, whosmat

from pacmo_core.formats.raw import FormatError
from pacmo_core.formats.tables import LARGEST

NUMERIC = ("double", "single", *(f"{u}int{n}" for u in ("", "u") for n in (8, 16, 32, 64)))
LARGEST_SIZE = 50_000_000  # numbers in a variable; bounds what a faulty file can cost

# What SciPy's reader has been seen to raise on broken files.
_BROKEN = (
    ValueError,
    TypeError,
    LookupError,
    ArithmeticError,
    AttributeError,
    NotImplementedError,
    EOFError,
    OSError,
    MemoryError,
    struct.error,
    zlib.error,
    matlab.MatReadError,
    Warning,
)


def list_variables(file: Path) -> list[str]:
    """List the file's variables by name, without reading their numbers.

    Raises
    ------
    FormatError
        If the file is no MATLAB file, or a variable is not plain numbers.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            variables = whosmat(str(file), appendmat=False)
    except _BROKEN as error:
        raise FormatError(file, f"no MATLAB file of version 4 to 7.2: {error}") from error
    for name, shape, kind in variables:
        if kind not in NUMERIC:
            raise FormatError(file, f"{name}: wanted plain numbers; got a {kind}")
        if np.prod([float(size) for size in shape]) > LARGEST_SIZE:
            raise FormatError(file, f"{name}: {shape} is more than {LARGEST_SIZE} numbers")
    return [name for name, _, _ in variables]


def read_variable(file: Path, name: str) -> NDArray[np.float64]:
    """Read one variable as float64.

    Raises
    ------
    FormatError
        If it is not there, or not all finite real numbers.
    """
    if name not in list_variables(file):
        raise FormatError(file, f"wanted the variable {name!r}")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            table = loadmat(str(file), appendmat=False, variable_names=[name])[name]
    except _BROKEN as error:
        raise FormatError(file, f"{name}: broken: {error}") from error
    if not isinstance(table, np.ndarray) or table.dtype.kind not in "fiu":
        raise FormatError(file, f"{name}: wanted real numbers; got {type(table).__name__}")
    return bounded(file, table)


def bounded(file: Path, table: NDArray[np.generic]) -> NDArray[np.float64]:
    """Turn real numbers into float64; refuse what is not finite or too large to be a place."""
    with np.errstate(invalid="ignore", over="ignore"):
        numbers: NDArray[np.float64] = table.astype(np.float64)
    if not (np.abs(numbers) <= LARGEST).all():
        place = tuple(int(i) for i in np.argwhere(~(np.abs(numbers) <= LARGEST))[0])
        raise FormatError(file, f"wanted numbers up to {LARGEST:g}; {place} has {numbers[place]}")
    return numbers
