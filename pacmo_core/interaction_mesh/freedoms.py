"""What may move near the source: bones that turn, roots that go; and the least energy in these."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cholesky, solve_triangular

from pacmo_core.interaction_mesh.blocks import in_pairs, in_time, pairs_of_frames, tie
from pacmo_core.interaction_mesh.energy import Quadratic
from pacmo_core.interaction_mesh.scene import Array, Scene, Single
from pacmo_core.interaction_mesh.trunk import paths

Floats = NDArray[np.floating]


@dataclass(frozen=True)
class Freedoms:
    """What may move: M = 2E + 6 of them in each frame.

    Parameters
    ----------
    bones : (M,), which bone or, after the bones, which root
    ways : (T, M, 3) unit vectors
    reach : (N, E + 2), ones where a bone or a root carries a joint
    """

    bones: NDArray[np.intp]
    ways: Single
    reach: Single

    def gather(self, values: Single) -> Single:
        """Turn what acts on joints, (T, N, 3, V), into what acts on freedoms, (T, M, V)."""
        carried = times(self.reach.T, values)[:, self.bones]
        gathered: Single = np.einsum("tmc,tmcv->tmv", self.ways, carried)
        return gathered

    def vectors(self, values: Single) -> Single:
        """Turn moves (T, M, V) into those of bones and roots, (T, E + 2, 3, V)."""
        first = np.flatnonzero(np.diff(self.bones, prepend=-1))
        return np.add.reduceat(self.ways[..., None] * values[:, :, None], first, axis=1)


def times(matrices: Single, values: Single) -> Single:
    """Multiply (T, R, N) or (R, N) into (T, N, 3, V)."""
    product = matrices @ values.reshape(*values.shape[:2], -1)
    return product.reshape(*product.shape[:2], *values.shape[2:])


def freedoms(scene: Scene, vectors: Single) -> Freedoms:
    """Let bones (T, E, 3) turn, and both roots go anywhere."""
    n_frames, n_bones, _ = vectors.shape
    aside = np.eye(3, dtype=np.float32)[np.abs(vectors).argmin(axis=-1)]
    first = np.cross(vectors, aside)
    second = np.cross(vectors, first)
    across = np.stack([first, second], axis=2).reshape(n_frames, 2 * n_bones, 3)
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    anywhere = np.broadcast_to(np.tile(np.eye(3, dtype=np.float32), (2, 1)), (n_frames, 6, 3))
    roots = np.repeat(np.eye(2), scene.n_joints, axis=0)
    return Freedoms(
        bones=np.repeat(np.arange(n_bones + 2), [2] * n_bones + [3, 3]),
        ways=np.concatenate([across, anywhere], axis=1),
        reach=np.concatenate([paths(scene), roots], axis=1).astype(np.float32),
    )


def least(energy: Quadratic, free: Freedoms, right: Single) -> Single:
    """Solve for the moves (T, M, V) of least energy by block Cholesky.

    In float32, twice as fast; in float64 where the anchor, which alone holds the scene as a whole,
    is lost in the rounding of the rest.
    """
    try:
        return _eliminate(energy, free, right).astype(np.float32, copy=False)
    except LinAlgError:
        return _eliminate(energy, free, right.astype(np.float64)).astype(np.float32)


def _eliminate(energy: Quadratic, free: Freedoms, right: Floats) -> Floats:
    """Compute in the precision of what is given.

    Raises
    ------
    LinAlgError
        If a pivot is not positive.
    """
    paired = in_pairs(right)
    solved = paired.reshape(len(paired), -1, right.shape[-1]).copy()
    pivots: list[Floats] = []
    ties: list[Floats] = []
    for number, (block, beyond) in enumerate(_blocks(energy, free)):
        pivot = block.astype(right.dtype)
        if number:
            pivot -= ties[-1].T @ ties[-1]
            solved[number] -= ties[-1].T @ solved[number - 1]
        pivot = cholesky(pivot, lower=True, overwrite_a=True, check_finite=False)
        solved[number] = _triangular(pivot, solved[number])
        pivots.append(pivot)
        ties.append(_triangular(pivot, beyond.T.astype(right.dtype)))
    for number in reversed(range(len(solved))):
        if number + 1 < len(solved):
            solved[number] -= ties[number] @ solved[number + 1]
        solved[number] = _triangular(pivots[number], solved[number], transposed=True)
    return solved.reshape(-1, *right.shape[1:])[: len(right)]


def _triangular(pivot: Floats, values: Floats, *, transposed: bool = False) -> Floats:
    trans: Literal["N", "T"] = "T" if transposed else "N"
    solved: Floats = solve_triangular(pivot, values, trans=trans, lower=True, check_finite=False)
    return solved


def _blocks(energy: Quadratic, free: Freedoms) -> Iterator[tuple[Array, Array]]:
    """Give H between the freedoms of two frames, and from these to those of the next two."""
    time, count = in_time(energy), len(free.bones)
    ways = in_pairs(free.ways.astype(np.float64)).reshape(-1, 2 * count, 3)
    heights = in_pairs(np.sqrt(energy.height * energy.held)).reshape(len(ways), -1)
    reach = np.kron(np.eye(2), free.reach).astype(np.float64)
    rows = np.concatenate([free.bones, free.bones + free.reach.shape[1]])
    for number, flat in enumerate(pairs_of_frames(energy, time, None)):
        here, height = ways[number], heights[number]
        block = _expand(reach.T @ flat @ reach, rows, here, here)
        standing = np.flatnonzero(height)
        raised = height[standing, None] * reach[standing][:, rows] * here[:, 1]
        block += raised.T @ raised
        # A frame that only fills up the last block has no ways to go.
        idle = np.flatnonzero(~here.any(axis=1))
        block[idle, idle] = 1
        if number + 1 < len(ways):
            tied = reach.T @ tie(time, reach, 2 * number)
            yield block, _expand(tied, rows, ways[number + 1], here)
        else:
            yield block, np.zeros_like(block)


def _expand(values: Array, rows: NDArray[np.intp], ways: Array, others: Array) -> Array:
    """Give freedoms the entries of their bones, as far as their ways agree."""
    found: Array = values.take(rows[:, None] * len(values) + rows)
    found *= ways @ others.T
    return found
