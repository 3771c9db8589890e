"""One factorisation a source, which serves every body that its motion is given to.

``H + penalties`` ties a frame to the two before it. Two frames a block make it block tridiagonal,
with ties that are diagonal between blocks, and block elimination needs only the inverse of each
pivot. Ground tells height from the other two directions, hence two stacks of pivots.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import tee

import numpy as np
from scipy.linalg import cholesky
from scipy.linalg.lapack import dpotri

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
    both = zip(_pivots(flat, time), _pivots(_raised(same, energy), time), strict=True)
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

    ``1 / (a^T H^-1 a)`` with a the difference of the two points in one frame, in height, which the
    ground holds harder: penalties in proportion to it suit hands in contact, feet on the ground and
    heads in the air alike.
    """
    time = in_time(energy)
    loose = _softness(_raised(pairs_of_frames(energy, time, None), energy), time, scene)
    stiff: Array = 1 / loose[: len(energy.held)]
    return stiff


def _softness(blocks: Iterable[Array], time: InTime, scene: Scene) -> Array:
    """``(2K, E)``: a^T H^-1 a.

    The blocks of the inverse on the diagonal follow from the pivots, last to first: Takahashi,
    Fagan and Chen (1973), *Formation of a sparse bus impedance matrix*.
    """
    pivots = [pivot.astype(np.float32) for pivot in _pivots(blocks, time)]
    n_points = time.same.shape[1]
    ends = np.concatenate([scene.bones, n_points + scene.bones]).T
    found = np.zeros((len(pivots), ends.shape[1]))
    block = pivots[-1].astype(np.float64)
    for number in reversed(range(len(pivots))):
        if number + 1 < len(pivots):
            pivot = pivots[number].astype(np.float64)
            half = tie_back(time, block, 2 * number)
            block = pivot + pivot @ tie_back(time, half.T, 2 * number) @ pivot
        parent, child = ends
        found[number] = block[child, child] + block[parent, parent] - 2 * block[child, parent]
    return found.reshape(2 * len(pivots), -1)


def _raised(blocks: Iterable[Array], energy: Quadratic) -> Iterator[Array]:
    """Add what the ground has on height."""
    heights = energy.height * in_pairs(energy.held)
    for block, height in zip(blocks, heights, strict=True):
        yield block + np.diag(height.reshape(-1))


def _pivots(blocks: Iterable[Array], time: InTime) -> Iterator[Array]:
    """Invert ``S_k = H_kk - C_k-1 S_k-1^-1 C_k-1^T`` in turn."""
    size = 2 * time.same.shape[1]
    filled = np.zeros((size, size))
    for number, block in enumerate(blocks):
        inverse = _inverse(block - filled)
        yield inverse
        filled = tie(time, tie(time, inverse, 2 * number).T, 2 * number)


def _inverse(block: Array) -> Array:
    """Invert what is symmetric and positive, in two thirds of the time of a solver."""
    root = cholesky(block, lower=True, check_finite=False)
    lower, _ = dpotri(root, lower=1)
    inverse: Array = np.tril(lower) + np.tril(lower, -1).T
    return inverse
