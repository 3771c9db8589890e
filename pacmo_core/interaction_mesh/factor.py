"""One factorisation a source, which serves every body that its motion is given to.

``H + penalties`` ties a frame to the two before it. Two frames a block make it block tridiagonal,
with ties that are diagonal between blocks, and block elimination needs only the inverse of each
pivot. Ground tells height from the other two directions, hence two stacks of pivots.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from pacmo_core.interaction_mesh.energy import Quadratic
from pacmo_core.interaction_mesh.scene import Array, Single
from pacmo_core.interaction_mesh.supports import steps_of


@dataclass(frozen=True)
class Factor:
    """The inverse pivots, frames in pairs; an odd last frame gets a frame of its own beside it.

    Parameters
    ----------
    across, upright : (K, 2N, 2N) float32, for the horizontal directions and for height
    next_frame : (2K, N, 1) float32, entry of the matrix between a frame and the next
    next_but_one : (2K,) the same between a frame and the next but one, for every joint
    """

    across: Single
    upright: Single
    next_frame: Single
    next_but_one: Single


def factorise(energy: Quadratic, penalty: Array) -> Factor:
    """Eliminate block by block in float64.

    Parameters
    ----------
    penalty : (T, N, N) or (1, N, N), what the penalties add to H within each frame
    """
    one, two, three = _in_time(energy)
    n_frames, n_points = one.shape
    padding = n_frames % 2
    within = np.zeros((n_frames + padding, n_points, n_points))
    within[:n_frames] = energy.within + penalty
    everyone = np.arange(n_points)
    within[:n_frames, everyone, everyone] += one
    within[n_frames:, everyone, everyone] = 1
    next_frame = _padded(two, len(within))
    next_but_one = _padded(three, len(within))
    across = _pivots(within, next_frame, next_but_one)
    within[:n_frames, everyone, everyone] += energy.height * energy.standing
    upright = _pivots(within, next_frame, next_but_one)
    return Factor(
        across, upright, next_frame.astype(np.float32)[..., None], next_but_one.astype(np.float32)
    )


def _in_time(energy: Quadratic) -> tuple[Array, Array, Array]:
    """Take acceleration and stance: entries on the diagonal, to the next frame, to the next."""
    n_frames, n_points = energy.standing.shape
    one, two = np.zeros((n_frames, n_points)), np.zeros((n_frames, n_points))
    three = np.zeros(n_frames)
    for shift, entry in enumerate((1, 4, 1)):
        one[shift : n_frames - 2 + shift] += energy.acceleration * entry
    two[: max(0, n_frames - 2)] -= 2 * energy.acceleration
    two[1 : max(1, n_frames - 1)] -= 2 * energy.acceleration
    stands = energy.stance * steps_of(energy.standing)
    one[:-1] += stands
    one[1:] += stands
    two[:-1] -= stands
    three[: max(0, n_frames - 2)] = energy.acceleration
    return one, two, three


def _padded(entries: Array, n_frames: int) -> Array:
    rows = np.zeros((n_frames, *entries.shape[1:]))
    rows[: len(entries)] = entries
    return rows


def _pivots(within: Array, next_frame: Array, next_but_one: Array) -> Single:
    """Invert ``S_k = H_kk - C_k-1 S_k-1^-1 C_k-1^T`` in turn."""
    n_points = within.shape[1]
    everyone = np.arange(n_points)
    size = 2 * n_points
    inverses = np.zeros((len(within) // 2, size, size), dtype=np.float32)
    filled = np.zeros((size, size))
    for block in range(len(inverses)):
        first = 2 * block
        pivot = -filled
        pivot[:n_points, :n_points] += within[first]
        pivot[n_points:, n_points:] += within[first + 1]
        pivot[everyone, n_points + everyone] += next_frame[first]
        pivot[n_points + everyone, everyone] += next_frame[first]
        inverse = cho_solve(cho_factor(pivot), np.eye(size))
        inverses[block] = inverse
        half = _tie(inverse, first, next_frame, next_but_one)
        filled = _tie(half.T, first, next_frame, next_but_one)
    return inverses


def _tie(rows: Array, first: int, next_frame: Array, next_but_one: Array) -> Array:
    """Multiply rows (2N, C) of the frames ``first``, ``first + 1`` into those of the next two."""
    n_points = len(rows) // 2
    upper, lower = rows[:n_points], rows[n_points:]
    return np.concatenate(
        [
            next_but_one[first] * upper + next_frame[first + 1][:, None] * lower,
            next_but_one[first + 1] * lower,
        ]
    )
