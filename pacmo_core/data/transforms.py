"""Canonical frames: a body's pelvis at the origin, its chest towards +z, and the way back."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.interaction import Motion
from pacmo_core.data.skeleton import Skeleton

# Mirror joints nearer than this share a place: some formats put hips into the root (metres).
APART = 0.01


@dataclass(frozen=True)
class Frame:
    """A place on the ground and in height, and a heading, in the world.

    Parameters
    ----------
    origin : (3,) float64, metres
    yaw : radians about +y, from +z towards +x
    """

    origin: NDArray[np.float64]
    yaw: float

    def to_local(self, motion: Motion) -> Motion:
        """See ``(..., 3)`` world metres from this frame, float32."""
        local: Motion = ((motion - self.origin) @ _turn(-self.yaw).T).astype(np.float32)
        return local

    def to_world(self, motion: Motion) -> Motion:
        """See ``(..., 3)`` metres of this frame from the world, float32: undoes ``to_local``."""
        world: Motion = (motion @ _turn(self.yaw).T + self.origin).astype(np.float32)
        return world


def body_frame(motion: Motion, skeleton: Skeleton) -> Frame:
    """Find the frame of a person's first pose: root at the origin, chest towards +z.

    Parameters
    ----------
    motion : (T, J, 3) float32, metres, y up

    Raises
    ------
    ValueError
        If the body has no heading: no mirror joints, or its sides are one above the other.
    """
    pose = motion[0].astype(np.float64)
    sides = _sides(pose, skeleton)
    lateral = sum((pose[left] - pose[right] for left, right in sides), start=np.zeros(3))
    if np.hypot(lateral[0], lateral[2]) < 1e-3:
        raise ValueError(
            f"skeleton {skeleton.name}: a heading needs left and right apart on the ground; "
            f"pairs {sides} differ by {lateral} m"
        )
    # Left is +x for who faces +z with y up; so (x, z) of the chest's direction is (-z, x) of it.
    return Frame(origin=pose[skeleton.root], yaw=float(np.arctan2(-lateral[2], lateral[0])))


def _sides(pose: NDArray[np.float64], skeleton: Skeleton) -> list[tuple[int, int]]:
    """Pair the joints where limbs leave the trunk: mirror joints that hang on one parent."""
    parents = skeleton.parents
    open_pairs = [(a, b) for a, b in skeleton.left_right if parents[a] == parents[b]]
    found = []
    for a, b in open_pairs:
        if np.linalg.norm(pose[a] - pose[b]) > APART:
            found.append((a, b))
        else:
            open_pairs.extend(
                p for p in skeleton.left_right if (parents[p[0]], parents[p[1]]) == (a, b)
            )
    return found


def _turn(yaw: float) -> NDArray[np.float64]:
    cos, sin = np.cos(yaw), np.sin(yaw)
    return np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]])
