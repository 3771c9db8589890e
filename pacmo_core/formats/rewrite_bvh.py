"""A BVH file again, its body and motion changed: same tree, same channels, same unit and axes.

The file's own rotations are kept as far as the bones' new directions allow, so that what positions
do not say, the twist of a limb or the way a hand is held, stays as it was captured.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pacmo_core.formats.bvh import Bvh
from pacmo_core.formats.euler import angles_like, rotation_of
from pacmo_core.formats.nearest_pose import aimed, forward, settled
from pacmo_core.formats.raw import FormatError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Rewritten:
    """The new text, and how far its joints are from where they were wanted.

    Parameters
    ----------
    text : of the file
    misses : (T, K) file units, of the joints that were given places; bones that leave one joint
        keep their angles to each other in a BVH, so that not every pose can be met
    """

    text: str
    misses: Array


def rewrite_bvh(file: Path, bvh: Bvh, joints: list[int], places: Array, scales: Array) -> Rewritten:
    """Write a file's body with other bones and another motion.

    Parameters
    ----------
    file : named in errors
    bvh : as it was read, of as many frames as ``places``
    joints : the K joints that have places, the root among them
    places : (T, K, 3) file units, in the file's world
    scales : (J,), of the bone that ends at each joint

    Raises
    ------
    FormatError
        If a joint does not turn about three axes, or the root does not move.
    """
    _check_channels(file, bvh)
    moved = _displacements(bvh) * scales[:, None]
    wanted: dict[int, Array] = {joint: places[:, k] for k, joint in enumerate(joints)}
    guess = aimed(bvh.parents, wanted, moved, _local_rotations(bvh))
    root, local = settled(bvh.parents, wanted, moved, guess)
    reached, _ = forward(bvh.parents, root, moved, local)
    misses = np.stack([np.linalg.norm(reached[:, j] - wanted[j], axis=-1) for j in joints], axis=1)
    return Rewritten(_text(bvh, scales, _rows(bvh, root, moved, local)), misses)


def _check_channels(file: Path, bvh: Bvh) -> None:
    for joint, channels in enumerate(bvh.channels):
        axes = [channel[0] for channel in channels if channel.endswith("rotation")]
        if joint not in bvh.end_sites and len(set(axes)) != 3:
            name = bvh.joints[joint]
            raise FormatError(file, f"{name} turns about {len(axes)} axes; wanted three to write")
    if sum(channel.endswith("position") for channel in bvh.channels[0]) != 3:
        raise FormatError(file, f"{bvh.joints[0]} has no position channels to write")


def _displacements(bvh: Bvh) -> Array:
    """``(T, J, 3)`` from the parent in the parent's frame; a joint's own positions, or its offset.

    The root's is left out: its place is given.
    """
    moved = np.repeat(bvh.offsets[None], len(bvh.motion), axis=0)
    for joint, column, channel in _columns(bvh):
        if channel.endswith("position") and bvh.parents[joint] >= 0:
            moved[:, joint, "xyz".index(channel[0])] = bvh.motion[:, column]
    return moved


def _local_rotations(bvh: Bvh) -> Array:
    """``(T, J, 3, 3)``: each joint's against its parent's."""
    turns = np.tile(np.eye(3), (len(bvh.motion), len(bvh.joints), 1, 1))
    for joint, column, channel in _columns(bvh):
        if channel.endswith("rotation"):
            axis = "xyz".index(channel[0])
            turns[:, joint] = turns[:, joint] @ rotation_of(axis, bvh.motion[:, column])
    return turns


def _columns(bvh: Bvh) -> Iterator[tuple[int, int, str]]:
    """Yield joint, column of the motion, and name of every channel."""
    column = 0
    for joint, channels in enumerate(bvh.channels):
        for channel in channels:
            yield joint, column, channel
            column += 1


def _rows(bvh: Bvh, root: Array, moved: Array, local: Array) -> Array:
    """``(T, C)``: the motion, in the file's channels."""
    rows = np.zeros_like(bvh.motion)
    for joint, columns in _turning(bvh).items():
        order = ["xyz".index(name[0]) for name in columns]
        own = list(columns.values())
        rows[:, own] = angles_like(local[:, joint], order, bvh.motion[:, own])
    start = root - bvh.offsets[0]
    for joint, column, channel in _columns(bvh):
        if channel.endswith("position"):
            axis = "xyz".index(channel[0])
            rows[:, column] = (start if joint == 0 else moved[:, joint])[:, axis]
    return rows


def _turning(bvh: Bvh) -> dict[int, dict[str, int]]:
    """Give the rotation channels of each joint that turns, in order, with their columns."""
    found: dict[int, dict[str, int]] = {}
    for joint, column, channel in _columns(bvh):
        if channel.endswith("rotation"):
            found.setdefault(joint, {})[channel] = column
    return found


def _text(bvh: Bvh, scales: Array, rows: Array) -> str:
    lines = [
        "HIERARCHY",
        *_tree(bvh, bvh.offsets * scales[:, None], 0, 0),
        "MOTION",
        f"Frames: {len(rows)}",
        f"Frame Time: {bvh.frame_time:.9g}",
        *(" ".join(f"{value:.6f}" for value in row) for row in rows.tolist()),
    ]
    return "\n".join(lines) + "\n"


def _tree(bvh: Bvh, offsets: Array, joint: int, depth: int) -> Iterator[str]:
    """Write a joint and all below it."""
    tab, is_end = "  " * depth, joint in bvh.end_sites
    kind = "ROOT" if bvh.parents[joint] < 0 else "JOINT"
    yield f"{tab}End Site" if is_end else f"{tab}{kind} {bvh.joints[joint]}"
    yield f"{tab}{{"
    yield f"{tab}  OFFSET {' '.join(f'{value:.6f}' for value in offsets[joint])}"
    if not is_end:
        channels = bvh.channels[joint]
        yield f"{tab}  CHANNELS {len(channels)} {' '.join(c.capitalize() for c in channels)}"
    for child, parent in enumerate(bvh.parents):
        if parent == joint:
            yield from _tree(bvh, offsets, child, depth + 1)
    yield f"{tab}}}"
