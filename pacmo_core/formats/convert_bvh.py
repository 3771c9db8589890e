"""A BVH file in another unit, with another upward axis, at other times, or moved; its rig is kept.

Hierarchy, channels and their order stay, and no rotation is fitted: bones keep their lengths, and
the rest pose stands on the floor of the file as it did.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pacmo_core.formats.base import FormatError
from pacmo_core.formats.bvh import Bvh
from pacmo_core.formats.bvh_channels import (
    check_channels,
    columns_of,
    displacements,
    local_rotations,
    rows_of,
)
from pacmo_core.formats.fit_bones import ConstantBoneMotion
from pacmo_core.formats.rotations import euler_angles_near

Array = NDArray[np.float64]

TO_Z_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # of column vectors, from y up
SAME_TIME = 1e-3  # of the time between two frames: frames so near are one
SAME_BONE = 1e-3  # of the longest bone: bones that change by less are constant


def change_unit(bvh: Bvh, factor: float) -> Bvh:
    """Multiply all lengths of a file: offsets, and the channels of positions."""
    motion = bvh.motion.copy()
    for _, column, channel in columns_of(bvh):
        if channel.endswith("position"):
            motion[:, column] *= factor
    return replace(bvh, offsets=factor * bvh.offsets, motion=motion)


def move_root(bvh: Bvh, shift: Array) -> Bvh:
    """Add ``(3,)`` file units to the positions of the root; the rest pose stays."""
    motion = bvh.motion.copy()
    for joint, column, channel in columns_of(bvh):
        if joint == 0 and channel.endswith("position"):
            motion[:, column] += shift["xyz".index(channel[0])]
    return replace(bvh, motion=motion)


def check_constant_bones(file: Path, bvh: Bvh) -> None:
    """Refuse a file in which a joint moves in its parent's frame.

    Raises
    ------
    FormatError
        If position channels of a joint beside the root do so.
    """
    moved = displacements(bvh, bvh.offsets)[:, 1:]
    change = np.ptp(moved, axis=0).max(axis=1)
    lengths = np.linalg.norm(moved.mean(axis=0), axis=1)
    if change.max(initial=0.0) > SAME_BONE * lengths.max(initial=0.0):
        name = bvh.joints[1 + int(change.argmax())]
        raise FormatError(file, f"the bone to {name} changes; wanted bones of constant length")


def bone_motion(bvh: Bvh) -> ConstantBoneMotion:
    """Return the motion of a file's joints, in its unit and axes, without End Sites.

    In the rest pose no joint is rotated. Bones are constant (``check_constant_bones``).
    """
    joints = np.setdiff1d(np.arange(len(bvh.joints)), bvh.end_sites)
    moved = displacements(bvh, bvh.offsets)[:, joints]
    offsets = moved.mean(axis=0)
    offsets[0] = 0
    return ConstantBoneMotion(offsets, moved[:, 0], local_rotations(bvh)[:, joints])


def change_axes(file: Path, bvh: Bvh, from_up: str, to_up: str) -> Bvh:
    """Turn a file to another upward axis, ``y`` or ``z``: the motion, and the rest pose with it.

    The frames of all joints turn with the world, as a program of that axis has them. So each offset
    is turned, and each rotation ``R`` becomes ``Q R Q^T`` with the turn ``Q`` of the world.

    Raises
    ------
    FormatError
        If the channels of a joint cannot hold that.
    """
    if from_up == to_up:
        return bvh
    check_channels(file, bvh)
    for name, channels in zip(bvh.joints, bvh.channels, strict=True):
        n_positions = sum(channel.endswith("position") for channel in channels)
        if n_positions not in (0, 3):
            reason = f"{name} has {n_positions} position channels; wanted none or three to turn"
            raise FormatError(file, reason)
    turn = TO_Z_UP if to_up == "z" else TO_Z_UP.T
    bones = displacements(bvh, bvh.offsets) @ turn.T
    local = turn @ local_rotations(bvh) @ turn.T
    return replace(
        bvh,
        offsets=bvh.offsets @ turn.T,
        motion=rows_of(bvh, bones, local, euler_angles_near),
    )


def resample_bvh(file: Path, bvh: Bvh, times: Array, at: Array) -> Bvh:
    """Return a file at other times: rotations by slerp (Shoemake 1985), positions linearly.

    Frames whose time is kept are those of the file.

    Parameters
    ----------
    times : (T,) seconds, of the file's frames, rising
    at : (N,) seconds, within ``times``, evenly spaced

    Raises
    ------
    FormatError
        If the channels of a joint cannot hold the rotations between two frames.
    """
    before = (np.searchsorted(times, at, side="right") - 1).clip(0, len(times) - 2)
    shares = ((at - times[before]) / (times[before + 1] - times[before])).clip(0, 1)
    nearest = np.where(shares < 0.5, before, before + 1)
    step = float(np.median(np.diff(at)))
    kept = replace(bvh, frame_time=step, motion=bvh.motion[nearest])
    between = np.abs(at - times[nearest]) > SAME_TIME * np.diff(times)[before]
    if not between.any():
        return kept
    check_channels(file, bvh)
    first, last = (
        replace(bvh, motion=bvh.motion[frames[between]]) for frames in (before, before + 1)
    )
    share = shares[between, None, None]
    local = _slerp(local_rotations(first), local_rotations(last), share)
    bones = (1 - share) * displacements(first, bvh.offsets)
    bones += share * displacements(last, bvh.offsets)
    # Of the angles that give a rotation, those nearest to the nearest frame's.
    near = replace(bvh, motion=kept.motion[between])
    motion = kept.motion.copy()
    motion[between] = rows_of(near, bones, local, euler_angles_near)
    return replace(kept, motion=motion)


def _slerp(first: Array, last: Array, share: Array) -> Array:
    """``(T, J, 3, 3)``: rotations on the shortest ways, at shares (T, 1, 1)."""
    way = Rotation.from_matrix((first.swapaxes(-1, -2) @ last).reshape(-1, 3, 3)).as_rotvec()
    turned = share * way.reshape(*first.shape[:2], 3)
    rotations: Array = first @ Rotation.from_rotvec(turned.reshape(-1, 3)).as_matrix().reshape(
        first.shape
    )
    return rotations
