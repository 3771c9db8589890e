"""A rig: the hierarchy and the bones of a person in a BVH file, on which a motion is written.

A motion of the model's joints is fitted to it; the file's own motion is written bone for bone.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pacmo_core.commands.captures import OutputSpace, meant_times
from pacmo_core.commands.reading import (
    ReadOptions,
    ReadPerson,
    Source,
    check_legs,
    name_model_joints,
    read_people,
)
from pacmo_core.data.interaction import Motion
from pacmo_core.data.segments import upright_frames
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.finish.body import TargetBody, body_of
from pacmo_core.formats.bvh import Bvh, read_bvh
from pacmo_core.formats.bvh_channels import format_file
from pacmo_core.formats.bvh_pairs import BvhPairs
from pacmo_core.formats.convert_bvh import change_axes, change_unit, resample_bvh
from pacmo_core.formats.inverse_kinematics import PointTargets
from pacmo_core.formats.registry import DEFAULT_SETTINGS, PersonMotion
from pacmo_core.formats.resample import frame_rate, from_y_up, sample_times
from pacmo_core.formats.write_bvh import write_on_rig
from pacmo_core.project.workspace import CommandError


@dataclass(frozen=True)
class TargetRig:
    """A person's BVH file, and the joints of a model in it.

    Parameters
    ----------
    file : as it was read
    bvh : its hierarchy and motion
    space : its unit and upward axis
    joints : its C joints, without End Sites
    weights : (J, C) of these in each of the model's
    motion : the joints of the model in the file
    named : how these were found in it; empty if by their names
    """

    file: Path
    bvh: Bvh
    space: OutputSpace
    joints: tuple[str, ...]
    weights: NDArray[np.float64]
    motion: PersonMotion
    named: str

    @property
    def body(self) -> TargetBody:
        """The body, in the joints of the model, standing upright."""
        motion, skeleton = self.motion.motion, self.motion.skeleton
        return body_of(motion[upright_frames(motion, skeleton)], skeleton)

    @property
    def sole(self) -> float:
        """Metres by which End Sites are below the lowest joint of the file's own motion."""
        heights = self.bvh.positions()[..., "xyz".index(self.space.up)] * self.space.unit
        joints = np.delete(heights, self.bvh.end_sites, axis=1)
        return float(joints.min() - heights.min())

    def text(
        self,
        person: PersonMotion,
        aims: Motion,
        weights: NDArray[np.float64],
        space: OutputSpace,
    ) -> str:
        """Write a motion of the model's joints as a BVH file on the rig.

        Parameters
        ----------
        aims : (T, J, 3) float32, metres, y up, in place of the person's own motion
        weights : (T, J), of the squared distances to them
        space : of the file
        """
        shares = np.zeros((len(self.weights), len(self.bvh.joints)))
        shares[:, [self.bvh.joints.index(name) for name in self.joints]] = self.weights
        positions = from_y_up(aims, space.up).astype(np.float64) / space.unit
        targets = PointTargets(shares, positions, weights)
        bvh = self._in_space(space)
        model, fps = person.skeleton, frame_rate(person.times)
        return write_on_rig(self.file, bvh, targets, model, space.unit, fps)

    def copied(self, person: PersonMotion, space: OutputSpace) -> str:
        """Write the motion of the file itself at the times of a person."""
        bvh = self._in_space(space)
        return format_file(replace(bvh, frame_time=1 / frame_rate(person.times)), bvh.motion)

    def on_model(self, person: PersonMotion) -> PersonMotion:
        """Return the joints of the model of a person read from a file on the rig."""
        rows = person.skeleton.indices(self.joints)
        motion = np.einsum("jc,tcx->tjx", self.weights, person.motion[:, rows])
        return replace(person, skeleton=self.motion.skeleton, motion=motion.astype(np.float32))

    def _in_space(self, space: OutputSpace) -> Bvh:
        turned = change_axes(self.file, self.bvh, self.space.up, space.up)
        return change_unit(turned, self.space.unit / space.unit)


def read_rig(source: Source, model: Skeleton, options: ReadOptions) -> TargetRig:
    """Read the rig of the person who reacts.

    Raises
    ------
    CommandError, FormatError
        If it is no BVH file, or joints of the model are not named in it.
    """
    if source.file.suffix.lower() != ".bvh":
        raise CommandError(f"{source.file}: wanted a rig as a .bvh file")
    (read,) = read_people([source], replace(options, form="bvh"), "")
    return rig_of(source, read, model, options)


def rig_of(source: Source, read: ReadPerson, model: Skeleton, options: ReadOptions) -> TargetRig:
    """Return the rig of a person who was read from a BVH file."""
    names = name_model_joints(read.motion, model, source, options)
    named = replace(read.motion, skeleton=model, motion=names.apply(read.motion.motion))
    check_legs(source.file, named)
    return TargetRig(
        source.file,
        read_bvh(source.file),
        space_of(source.file, read),
        read.motion.skeleton.joints,
        names.weights,
        named,
        names.description,
    )


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
            times, at = meant_times(times), sample_times(meant_times(at), fps)
        resampled = resample_bvh(self.file, self.bvh, times, at)
        turned = change_axes(self.file, resampled, self.space.up, space.up)
        return change_unit(turned, self.space.unit / space.unit)


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
