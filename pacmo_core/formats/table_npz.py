"""Arrays of an NPZ file, without pickles: numbers and text alone, their sizes checked beforehand.

Unlike ``numpy.load``, which allocates what an array's header says, this refuses a header of more
than ``MAX_BYTES`` before it unpacks anything.
"""

import lzma
import warnings
import zipfile
import zlib
from collections.abc import Sequence
from math import prod
from pathlib import Path
from typing import IO

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from pacmo_core.formats.base import FormatError
from pacmo_core.formats.tables import NPY_ERRORS, short_reason

MAX_BYTES = 200_000_000  # of an unpacked array
_KINDS = "iufUS"  # integers, real numbers, text
_ZIP_ERRORS = (
    zipfile.BadZipFile,
    zlib.error,
    lzma.LZMAError,
    NotImplementedError,  # a compression that Python does not know
    RuntimeError,  # an encrypted file
)


def npz_arrays(file: Path, names: Sequence[str]) -> dict[str, NDArray[np.generic]]:
    """Read the arrays of these names that a file has; others are not opened.

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
                shape, dtype = _header(stream)
            _check(file, name, shape, dtype)
            with archive.open(f"{name}.npy") as stream:
                array: NDArray[np.generic] = npy.read_array(stream, allow_pickle=False)
    except FormatError:
        raise
    except (*_ZIP_ERRORS, *NPY_ERRORS) as error:
        raise FormatError(file, f"{name}: no array: {short_reason(error)}") from error
    return array


def _header(stream: IO[bytes]) -> tuple[tuple[int, ...], np.dtype[np.generic]]:
    version = npy.read_magic(stream)
    if version not in ((1, 0), (2, 0)):
        raise ValueError(f"version {version} of the format, wanted 1.0 or 2.0")
    read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    shape, _, dtype = read(stream)
    return shape, dtype


def _check(file: Path, name: str, shape: tuple[int, ...], dtype: np.dtype[np.generic]) -> None:
    if dtype.kind not in _KINDS:
        what = "Python objects, which are pickled" if dtype.hasobject else str(dtype)
        raise FormatError(file, f"{name}: wanted plain numbers or text; got {what}")
    if min(shape, default=0) < 0 or prod(shape) * dtype.itemsize > MAX_BYTES:
        raise FormatError(file, f"{name}: {shape} of {dtype} is more than {MAX_BYTES} bytes")
