"""Canonical coordinates: root at the origin, chest towards +z, and the transform back."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.interaction import Motion
from pacmo_core.data.skeleton import Skeleton

# Metres. Mirror joints nearer than this are one point: some formats put both hips into the root.
MIN_SEPARATION = 0.01


@dataclass(frozen=True)
class Frame:
    """A coordinate frame: a position and a heading in the world.

    Parameters
    ----------
    origin : (3,) float64, metres
    yaw : radians about +y, from +z towards +x
    """

    origin: NDArray[np.float64]
    yaw: float

    def to_local(self, motion: Motion) -> Motion:
        """Transform ``(..., 3)`` metres from world to frame coordinates, float32."""
        local: Motion = ((motion - self.origin) @ _rotation_y(-self.yaw).T).astype(np.float32)
        return local

    def to_world(self, motion: Motion) -> Motion:
        """Transform from frame to world coordinates, float32: the inverse of ``to_local``."""
        world: Motion = (motion @ _rotation_y(self.yaw).T + self.origin).astype(np.float32)
        return world


def body_frame(motion: Motion, skeleton: Skeleton) -> Frame:
    """Compute the frame of a person's first pose: root at the origin, chest towards +z.

    Parameters
    ----------
    motion : (T, J, 3) float32, metres, y up

    Raises
    ------
    ValueError
        If the heading is undefined: no mirror joints, or left vertically above right.
    """
    pose = motion[0].astype(np.float64)
    pairs = _lateral_pairs(pose, skeleton)
    lateral = sum((pose[left] - pose[right] for left, right in pairs), start=np.zeros(3))
    if np.hypot(lateral[0], lateral[2]) < 1e-3:
        raise ValueError(
            f"skeleton {skeleton.name}: a heading needs left and right apart on the ground; "
            f"pairs {pairs} differ by {lateral} m"
        )
    # Facing +z with y up, left is +x; so (x, z) of the chest's direction is (-z, x) of it.
    return Frame(origin=pose[skeleton.root], yaw=float(np.arctan2(-lateral[2], lateral[0])))


def _lateral_pairs(pose: NDArray[np.float64], skeleton: Skeleton) -> list[tuple[int, int]]:
    """List the mirror joints with a common parent: shoulders and hips, where limbs start."""
    parents = skeleton.parents
    candidates = [(a, b) for a, b in skeleton.left_right if parents[a] == parents[b]]
    selected = []
    for a, b in candidates:
        if np.linalg.norm(pose[a] - pose[b]) > MIN_SEPARATION:
            selected.append((a, b))
        else:
            candidates.extend(
                p for p in skeleton.left_right if (parents[p[0]], parents[p[1]]) == (a, b)
            )
    return selected


def _rotation_y(yaw: float) -> NDArray[np.float64]:
    cos, sin = np.cos(yaw), np.sin(yaw)
    return np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]])


def line_between(first: Motion, second: Motion) -> float:
    """Return the yaw, about +y, of the line along which two people are apart, from first to second.

    It is the principal direction of their distances on the ground: people who change sides are
    apart along a line too, and their mean distance is near none.

    Parameters
    ----------
    first, second : (T, 3) metres, of their roots
    """
    apart = (second.astype(np.float64) - first)[:, [0, 2]]
    line = np.linalg.eigh(apart.T @ apart)[1][:, -1]
    if line @ apart.mean(axis=0) < 0:
        line = -line
    return float(np.arctan2(-line[1], line[0]))
