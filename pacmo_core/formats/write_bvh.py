"""Motions as BVH text: metres, y up, one person a file."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.interaction import Motion
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.formats.fit_bones import Fitted, fit_bones

# The order in which a joint turns: gimbal lock, at a right angle of the middle one, lies where
# people look straight up or down.
TURNS = "Zrotation Xrotation Yrotation"
LOCKED = 1e-6  # cosine of the middle angle below which the outer two are one


def format_bvh(motion: Motion, fps: float, skeleton: Skeleton) -> str:
    """Write a motion as the nearest one of constant bones (see ``fit_bones``).

    Every leaf of the tree has an End Site of no length, so that its place is a joint's.

    Parameters
    ----------
    motion : (T, J, 3) float32, metres, y up
    fps : frames a second
    """
    return format_fitted(fit_bones(motion, skeleton), fps, skeleton)


def format_fitted(fitted: Fitted, fps: float, skeleton: Skeleton) -> str:
    """Write a motion of constant bones, whatever its unit and the axis that is up."""
    depth_first = list(_depth_first(skeleton, skeleton.root))
    columns = [fitted.root, *(angles(fitted.rotations[:, joint]) for joint in depth_first)]
    rows = np.concatenate(columns, axis=1)
    lines = [
        "HIERARCHY",
        *_tree(fitted, skeleton, skeleton.root, 0),
        "MOTION",
        f"Frames: {len(rows)}",
        f"Frame Time: {1 / fps:.9f}",
        *(" ".join(f"{value:.6f}" for value in row) for row in rows.tolist()),
    ]
    return "\n".join(lines) + "\n"


def angles(rotations: NDArray[np.float64]) -> NDArray[np.float64]:
    """``(T, 3)`` degrees about z, x, y in turn, without jumps, of ``(T, 3, 3)`` rotations."""
    r = rotations
    x = np.arcsin(r[:, 2, 1].clip(-1, 1))
    locked = np.hypot(r[:, 0, 1], r[:, 1, 1]) < LOCKED
    y = np.where(locked, 0.0, np.arctan2(-r[:, 2, 0], r[:, 2, 2]))
    free_z = np.arctan2(-r[:, 0, 1], r[:, 1, 1])
    z = np.where(locked, np.arctan2(r[:, 1, 0], r[:, 0, 0]), free_z)
    found: NDArray[np.float64] = np.degrees(np.unwrap(np.stack([z, x, y], axis=-1), axis=0))
    return found


def _depth_first(skeleton: Skeleton, joint: int) -> Iterator[int]:
    yield joint
    for child, parent in enumerate(skeleton.parents):
        if parent == joint:
            yield from _depth_first(skeleton, child)


def _tree(fitted: Fitted, skeleton: Skeleton, joint: int, depth: int) -> Iterator[str]:
    """Write a joint and all below it."""
    tab, name = "  " * depth, skeleton.joints[joint]
    root = joint == skeleton.root
    offset = " ".join(f"{value:.6f}" for value in fitted.offsets[joint])
    places = "6 Xposition Yposition Zposition" if root else "3"
    yield f"{tab}{'ROOT' if root else 'JOINT'} {name}"
    yield f"{tab}{{"
    yield f"{tab}  OFFSET {offset}"
    yield f"{tab}  CHANNELS {places} {TURNS}"
    children = [child for child, parent in enumerate(skeleton.parents) if parent == joint]
    for child in children:
        yield from _tree(fitted, skeleton, child, depth + 1)
    if not children:
        yield from (f"{tab}  End Site", f"{tab}  {{", f"{tab}    OFFSET 0 0 0", f"{tab}  }}")
    yield f"{tab}}}"
