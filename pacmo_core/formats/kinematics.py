"""Turning frames of reference about their own axes: what forward kinematics is made of.

A frame over time is ``(3, 3, T)``: column, row, instant. Columns come first because a turn
about one axis mixes the other two columns and touches nothing else.
"""

import numpy as np
from numpy.typing import NDArray

Frames = NDArray[np.float64]


def still_frames(count: int) -> Frames:
    """Give the world's own axes at ``count`` instants."""
    return np.repeat(np.eye(3)[:, :, None], count, axis=2)


def turn(frames: Frames, axis: int, degrees: NDArray[np.float64]) -> Frames:
    """Turn about an axis of the frame itself: ``frames @ R(axis, degrees)`` on column vectors.

    Parameters
    ----------
    frames : (3, 3, T) column, row, instant
    axis : 0, 1 or 2
    degrees : (T,) counter-clockwise as seen from the axis' tip
    """
    angle = np.radians(degrees)
    cos, sin = np.cos(angle), np.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turned = frames.copy()
    turned[i] = cos * frames[i] + sin * frames[j]
    turned[j] = cos * frames[j] - sin * frames[i]
    return turned


def carry(frames: Frames, vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Express in the world vectors given in the frames: ``(T, 3)`` from ``(3,)`` or ``(T, 3)``."""
    moving = np.broadcast_to(vectors, (frames.shape[2], 3))
    world: NDArray[np.float64] = np.einsum("crt,tc->tr", frames, moving)
    return world
