"""The channels of a BVH file as rotations and displacements, and back; a file as text."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pacmo_core.formats.base import FormatError
from pacmo_core.formats.bvh import Bvh
from pacmo_core.formats.rotations import axis_rotations

Array = NDArray[np.float64]


def check_channels(file: Path, bvh: Bvh) -> None:
    """Refuse a file whose channels cannot hold every rotation, and every position of the root.

    Raises
    ------
    FormatError
        If a joint has not three rotation channels, or the root no position channels.
    """
    for joint, channels in enumerate(bvh.channels):
        axes = [channel[0] for channel in channels if channel.endswith("rotation")]
        if joint not in bvh.end_sites and len(set(axes)) != 3:
            name = bvh.joints[joint]
            raise FormatError(file, f"{name} has {len(axes)} rotation axes; wanted three to write")
    if sum(channel.endswith("position") for channel in bvh.channels[0]) != 3:
        raise FormatError(file, f"{bvh.joints[0]} has no position channels to write")


def displacements(bvh: Bvh, offsets: Array) -> Array:
    """``(T, J, 3)`` from the parent, in its frame: position channels, or the offset (J, 3).

    The root's is its position in the world.
    """
    moved = np.repeat(offsets[None], len(bvh.motion), axis=0)
    for joint, column, channel in columns_of(bvh):
        if channel.endswith("position"):
            moved[:, joint, "xyz".index(channel[0])] = bvh.motion[:, column]
    return moved


def local_rotations(bvh: Bvh) -> Array:
    """``(T, J, 3, 3)``: each joint's against its parent's."""
    rotations = np.tile(np.eye(3), (len(bvh.motion), len(bvh.joints), 1, 1))
    for joint, column, channel in columns_of(bvh):
        if channel.endswith("rotation"):
            axis = "xyz".index(channel[0])
            rotations[:, joint] = rotations[:, joint] @ axis_rotations(axis, bvh.motion[:, column])
    return rotations


def columns_of(bvh: Bvh) -> Iterator[tuple[int, int, str]]:
    """Yield joint, column of the motion, and name of every channel."""
    column = 0
    for joint, channels in enumerate(bvh.channels):
        for channel in channels:
            yield joint, column, channel
            column += 1


def rows_of(
    bvh: Bvh,
    moved: Array,
    local: Array,
    euler_angles: Callable[[Array, Sequence[int], Array], Array],
) -> Array:
    """``(T, C)``: the motion, in the file's channels; angles near those of the file's motion.

    Parameters
    ----------
    moved : (T, J, 3) from the parent, in its frame; the root's in the world
    local : (T, J, 3, 3), rotations against the parent
    """
    rows = np.zeros_like(bvh.motion)
    for joint, columns in _rotation_columns(bvh).items():
        order = ["xyz".index(name[0]) for name in columns]
        columns_of_joint = list(columns.values())
        rows[:, columns_of_joint] = euler_angles(
            local[:, joint], order, bvh.motion[:, columns_of_joint]
        )
    for joint, column, channel in columns_of(bvh):
        if channel.endswith("position"):
            rows[:, column] = moved[:, joint, "xyz".index(channel[0])]
    return rows


def _rotation_columns(bvh: Bvh) -> dict[int, dict[str, int]]:
    """List the rotation channels of each joint, in order, with their columns."""
    angles: dict[int, dict[str, int]] = {}
    for joint, column, channel in columns_of(bvh):
        if channel.endswith("rotation"):
            angles.setdefault(joint, {})[channel] = column
    return angles


def format_file(bvh: Bvh, rows: Array) -> str:
    """Write a file's hierarchy with a motion (T, C) in its channels."""
    lines = [
        "HIERARCHY",
        *_hierarchy_lines(bvh, 0, 0),
        "MOTION",
        f"Frames: {len(rows)}",
        f"Frame Time: {bvh.frame_time:.9g}",
        *(" ".join(f"{value:.6f}" for value in row) for row in rows.tolist()),
    ]
    return "\n".join(lines) + "\n"


def _hierarchy_lines(bvh: Bvh, joint: int, depth: int) -> Iterator[str]:
    """Write a joint and all its descendants."""
    tab, is_end = "  " * depth, joint in bvh.end_sites
    kind = "ROOT" if bvh.parents[joint] < 0 else "JOINT"
    yield f"{tab}End Site" if is_end else f"{tab}{kind} {bvh.joints[joint]}"
    yield f"{tab}{{"
    yield f"{tab}  OFFSET {' '.join(f'{value:.6f}' for value in bvh.offsets[joint])}"
    if not is_end:
        channels = bvh.channels[joint]
        yield f"{tab}  CHANNELS {len(channels)} {' '.join(c.capitalize() for c in channels)}"
    for child, parent in enumerate(bvh.parents):
        if parent == joint:
            yield from _hierarchy_lines(bvh, child, depth + 1)
    yield f"{tab}}}"
