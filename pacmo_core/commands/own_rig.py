"""People of BVH files on their own rigs: exported without a fit, bone for bone."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pacmo_core.commands.captures import OutputSpace, meant_rate
from pacmo_core.commands.reading import ReadPerson, Source
from pacmo_core.formats.bvh import Bvh, read_bvh
from pacmo_core.formats.bvh_pairs import BvhPairs
from pacmo_core.formats.convert_bvh import change_axes, change_unit, resample_bvh
from pacmo_core.formats.registry import DEFAULT_SETTINGS
from pacmo_core.formats.resample import sample_times

Array = NDArray[np.float64]


@dataclass(frozen=True)
class OwnRig:
    """A person's BVH file.

    Parameters
    ----------
    file : as it was read
    bvh : its hierarchy and motion
    space : its unit and upward axis
    times : (T,) seconds, of its frames
    """

    file: Path
    bvh: Bvh
    space: OutputSpace
    times: Array

    def converted(self, at: Array, fps: float | None, space: OutputSpace) -> Bvh:
        """Return the file at other times, in another unit and with another upward axis.

        Parameters
        ----------
        at : (N,) seconds, within the file's times
        fps : frames a second from the first of these times to the last, instead of them

        Raises
        ------
        FormatError
            If its channels cannot hold that.
        """
        times = self.times
        if fps is not None:
            times, at = _meant(times), sample_times(_meant(at), fps)
        resampled = resample_bvh(self.file, self.bvh, times, at)
        turned = change_axes(self.file, resampled, self.space.up, space.up)
        return change_unit(turned, self.space.unit / space.unit)


def _meant(times: Array) -> Array:
    """``(T,)`` seconds: the times of frames at the rate that was meant.

    A rate that is a multiple of it keeps the frames of a file, whose Frame Time is rounded.
    """
    fps = float(1 / np.median(np.diff(times)))
    meant: Array = times[0] + (times - times[0]) * (fps / meant_rate(fps))
    return meant


def space_of(file: Path, read: ReadPerson) -> OutputSpace:
    """Return the unit and the upward axis with which a BVH file was read."""
    pairs = BvhPairs(**{**DEFAULT_SETTINGS["bvh"], **read.settings})
    return OutputSpace(pairs.metres(file), pairs.up_axis)


def own_rigs(sources: Sequence[Source], read: Sequence[ReadPerson]) -> list[OwnRig]:
    """Return the rigs of people who were read, if all are of BVH files; else none."""
    if any(source.file.suffix.lower() != ".bvh" for source in sources):
        return []
    return [
        OwnRig(
            source.file, read_bvh(source.file), space_of(source.file, person), person.motion.times
        )
        for source, person in zip(sources, read, strict=True)
    ]
