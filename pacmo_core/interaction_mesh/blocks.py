"""Frames in pairs, as block elimination takes them, and one block's working space."""

from typing import TypeVar

import numpy as np

from pacmo_core.interaction_mesh.scene import Array, Single

Values = TypeVar("Values", Array, Single)

# From x, y, z to the order of the solver. Its own inverse.
AXES = [0, 2, 1]


class Work:
    """Arrays of one block, made once; the scales of the bodies (E, V)."""

    def __init__(self, shape: tuple[int, int, int], n_bodies: int, scales: Single) -> None:
        n_frames, n_rows, n_points = shape
        self.n_bodies, self.scales = n_bodies, scales
        self.halves = (n_frames, n_points, 3 * n_bodies)
        self._vectors = (n_frames, n_rows, 3, n_bodies)
        self.tied = np.zeros((n_frames * n_points, 3 * n_bodies), dtype=np.float32)
        self.moved = np.zeros_like(self.tied)
        self.held = np.zeros((n_frames, n_rows, 3 * n_bodies), dtype=np.float32)
        self.share = np.zeros((n_frames, n_rows, n_bodies), dtype=np.float32)
        self.wanted = np.zeros((n_frames, len(scales), n_bodies), dtype=np.float32)

    def vectors(self, rows: Single) -> Single:
        """See rows of all directions as vectors."""
        return rows.reshape(self._vectors)


def in_blocks(rows: Array) -> Single:
    """Turn (V, T, N, 3) into (K, 2N, 3V) float32, as the solver wants it."""
    turned = np.ascontiguousarray(rows[..., AXES].transpose(1, 2, 3, 0), dtype=np.float32)
    paired = in_pairs(turned)
    n_blocks, _, n_points = paired.shape[:3]
    blocks: Single = paired.reshape(n_blocks, 2 * n_points, -1)
    return blocks


def in_pairs(rows: Values) -> Values:
    """Turn (T, ...) into (K, 2, ...); zeros fill up an odd end."""
    if len(rows) % 2:
        rows = np.concatenate([rows, np.zeros_like(rows[:1])])
    paired: Values = rows.reshape(len(rows) // 2, 2, *rows.shape[1:])
    return paired
