"""One factorisation a source, which serves every body that its motion is given to.

``H + penalties`` ties a frame to the two before it. Two frames a block make it block tridiagonal,
with ties that are diagonal between blocks, and block elimination needs only the inverse of each
pivot. Ground tells height from the other two directions, hence two stacks of pivots.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import tee

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from pacmo_core.interaction_mesh.blocks import (
    InTime,
    in_pairs,
    in_time,
    pairs_of_frames,
    tie,
    tie_back,
)
from pacmo_core.interaction_mesh.energy import Quadratic
from pacmo_core.interaction_mesh.rows import Rows
from pacmo_core.interaction_mesh.scene import Array, Scene, Single


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


def factorise(energy: Quadratic, rows: Rows) -> Factor:
    """Eliminate block by block in float64."""
    time = in_time(energy)
    size = 2 * time.same.shape[1]
    across = np.zeros((len(time.same) // 2, size, size), dtype=np.float32)
    upright = np.zeros_like(across)
    flat, same = tee(pairs_of_frames(energy, time, rows))
    heights = energy.height * in_pairs(energy.held).reshape(len(across), -1)
    raised = (block + np.diag(height) for block, height in zip(same, heights, strict=True))
    both = zip(_pivots(flat, time), _pivots(raised, time), strict=True)
    for number, (level, high) in enumerate(both):
        across[number], upright[number] = level, high
    return Factor(
        across,
        upright,
        time.next_frame.astype(np.float32)[..., None],
        time.next_but_one.astype(np.float32),
    )


def stiffness(energy: Quadratic, scene: Scene) -> Array:
    """``(T, E)``: the force a metre with which the energy alone holds a bone's end to its parent.

    ``1 / (a^T H^-1 a)`` with a the difference of the two points in one frame: penalties in
    proportion to it suit hands in contact and heads in the air alike. The blocks of the inverse on
    the diagonal follow from the pivots, last to first: Takahashi, Fagan and Chen (1973),
    *Formation of a sparse bus impedance matrix*.
    """
    time = in_time(energy)
    blocks = pairs_of_frames(energy, time, None)
    pivots = np.stack([pivot.astype(np.float32) for pivot in _pivots(blocks, time)])
    n_points = energy.held.shape[1]
    parent, child = scene.bones.T
    found = np.zeros((len(pivots), 2, len(parent)))
    block = np.zeros(pivots.shape[1:])
    for number in reversed(range(len(pivots))):
        pivot = pivots[number].astype(np.float64)
        if number + 1 < len(pivots):
            half = tie_back(time, block, 2 * number)
            block = pivot + pivot @ tie_back(time, half.T, 2 * number) @ pivot
        else:
            block = pivot
        for half_number in (0, 1):
            part = slice(half_number * n_points, (half_number + 1) * n_points)
            inverse = block[part, part]
            found[number, half_number] = (
                inverse[child, child] + inverse[parent, parent] - 2 * inverse[child, parent]
            )
    stiff: Array = 1 / found.reshape(-1, len(parent))[: len(energy.held)]
    return stiff


def _pivots(blocks: Iterable[Array], time: InTime) -> Iterator[Array]:
    """Invert ``S_k = H_kk - C_k-1 S_k-1^-1 C_k-1^T`` in turn."""
    size = 2 * time.same.shape[1]
    filled, identity = np.zeros((size, size)), np.eye(size)
    for number, block in enumerate(blocks):
        inverse = cho_solve(cho_factor(block - filled), identity)
        yield inverse
        filled = tie(time, tie(time, inverse, 2 * number).T, 2 * number)
