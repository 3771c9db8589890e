"""Frames in pairs, as block elimination takes them, and H between them."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from pacmo_core.interaction_mesh.energy import Quadratic
from pacmo_core.interaction_mesh.rows import Rows, differences
from pacmo_core.interaction_mesh.scene import Array, Single

Values = TypeVar("Values", Array, Single, NDArray[np.intp])

# From x, y, z to the order of the solver, in which the two directions that share a factorisation
# lie together. Its own inverse.
AXES = [0, 2, 1]


@dataclass(frozen=True)
class InTime:
    """What H has between a joint's places at different times, from acceleration and stance.

    Parameters
    ----------
    same : (2K, N), on the diagonal
    next_frame : (2K, N), between a frame and the next
    next_but_one : (2K,), between a frame and the next but one, for every joint
    """

    same: Array
    next_frame: Array
    next_but_one: Array


def in_time(energy: Quadratic) -> InTime:
    """Take the entries; a frame that fills up the last block stands alone, with ones."""
    n_frames, n_points = energy.held.shape
    size = n_frames + n_frames % 2
    same, after = np.zeros((size, n_points)), np.zeros((size, n_points))
    skip = np.zeros(size)
    n_bends = max(0, n_frames - 2)
    for shift, entry in enumerate((1, 4, 1)):
        same[shift : n_bends + shift] += energy.acceleration * entry
    for shift in (0, 1):
        after[shift : n_bends + shift] -= 2 * energy.acceleration
    skip[:n_bends] = energy.acceleration
    stands = energy.stance * energy.steps_held
    same[: n_frames - 1] += stands
    same[1:n_frames] += stands
    after[: n_frames - 1] -= stands
    same[n_frames:] = 1
    return InTime(same, after, skip)


def pairs_of_frames(energy: Quadratic, time: InTime, rows: Rows | None) -> Iterator[Array]:
    """Give what H and the penalties have within each block, (2N, 2N), height apart."""
    n_frames, n_points = energy.held.shape
    everyone = np.arange(n_points)
    for first in range(0, len(time.same), 2):
        block = np.zeros((2 * n_points, 2 * n_points))
        frames = slice(first, min(first + 2, n_frames))
        inside = energy.within(frames)
        if rows is not None:
            matrix = differences(rows.pairs[frames], n_points)
            inside += matrix.transpose(0, 2, 1) @ (rows.weights[frames, :, None] * matrix)
        for half, values in enumerate(inside):
            part = slice(half * n_points, (half + 1) * n_points)
            block[part, part] = values
        here = np.arange(2 * n_points)
        block[here, here] += time.same[first : first + 2].reshape(-1)
        block[everyone, n_points + everyone] += time.next_frame[first]
        block[n_points + everyone, everyone] += time.next_frame[first]
        yield block


def tie(time: InTime, rows: Array, first: int) -> Array:
    """Multiply rows (2N, C) of the frames ``first``, ``first + 1`` into those of the next two."""
    upper, lower = np.split(rows, 2)
    skip = time.next_but_one
    top = skip[first] * upper + time.next_frame[first + 1][:, None] * lower
    return np.concatenate([top, skip[first + 1] * lower])


def tie_back(time: InTime, rows: Array, first: int) -> Array:
    """Multiply by the transpose of ``tie``: from the next two frames into these."""
    upper, lower = np.split(rows, 2)
    skip = time.next_but_one
    bottom = time.next_frame[first + 1][:, None] * upper + skip[first + 1] * lower
    return np.concatenate([skip[first] * upper, bottom])


def in_pairs(rows: Values) -> Values:
    """Turn (T, ...) into (K, 2, ...); zeros fill up an odd end."""
    if len(rows) % 2:
        rows = np.concatenate([rows, np.zeros_like(rows[:1])])
    paired: Values = rows.reshape(len(rows) // 2, 2, *rows.shape[1:])
    return paired
