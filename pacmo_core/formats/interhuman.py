"""InterHuman and InterX as arrays: ``person1/<id>.npy`` and ``person2/<id>.npy``.

A row a frame; columns 0–65 are the 22 joints of the SMPL body × xyz, metres; further columns (a
mesh, rotations) are not read. 30 fps. The code of InterGen (Liang et al. 2024) rotates the arrays
from z up to y up; the axis is a setting.
"""

import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.lib.format import open_memmap
from numpy.typing import NDArray

from pacmo_core.data.skeleton import INTERHUMAN22
from pacmo_core.formats.base import (
    FormatError,
    Person,
    RawSequence,
    Reading,
    check_file,
    check_fps,
    check_up,
    check_work,
    pair_people,
    to_y_up,
)
from pacmo_core.formats.pairing import PairRule, pair_files
from pacmo_core.formats.tables import NPY_ERRORS, to_float64

_COLUMNS = 22 * 3

RULES = (
    PairRule(
        pattern=r"(?P<folder>(?:.*/)?)(?P<person>person1|person2)/(?P<id>[^/]+)\.(?i:npy)",
        persons=("person1", "person2"),
        name="{folder}{id}",
        recording="{id}",
        action="",
        subjects=("", ""),
    ),
)


@dataclass(frozen=True, kw_only=True)
class InterHuman:
    """Two arrays a sequence.

    Parameters
    ----------
    fps : frames a second, 30 as published
    up : the axis that is up, ``y`` or ``z``
    """

    fps: float
    up: str

    def __post_init__(self) -> None:
        check_fps(self.fps)
        check_up(self.up)

    def find(self, root: Path) -> list[RawSequence]:
        """List every pair, and every array without the other person's."""
        return pair_files(root, r".*\.npy", RULES)

    def read(self, sequence: RawSequence) -> Reading:
        """Read both arrays.

        Raises
        ------
        FormatError
            If a file is broken (said first), the second is missing, or the two do not match.
        """
        return pair_people([self._person(file) for file in sequence.files])

    def _person(self, file: Path) -> Person:
        joints = _read_array(file)[:, :_COLUMNS].reshape(-1, 22, 3)
        return Person(file, INTERHUMAN22, to_y_up(to_float64(file, joints), self.up), self.fps)


def _read_array(file: Path) -> NDArray[np.generic]:
    """Open a two-dimensional real array; mapped, so that columns not wanted are not read."""
    check_file(file)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            # Unlike np.load, this knows neither pickles, which run what the file says, nor zips.
            array = open_memmap(file, mode="r")
    except NPY_ERRORS as error:
        raise FormatError(file, f"no array of numbers: {error}") from error
    if array.dtype.kind not in "fiu":
        raise FormatError(file, f"wanted an array of real numbers; got {array.dtype}")
    if array.ndim != 2 or array.shape[1] < _COLUMNS:
        raise FormatError(file, f"wanted (T, {_COLUMNS} or more); got {array.shape}")
    check_work(file, len(array), 22)
    return array
