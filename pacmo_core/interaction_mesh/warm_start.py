"""How the two bodies answer, at first, when one bone grows: where the solver starts.

Near the source the best motion is linear in the scales: least E(U) where every bone gets its
length along the direction that it has. What is free are two ways for each bone to turn and three
for each root, so that one block elimination, frames in pairs, tells the answer to each bone; the
start for any body is a sum of these. As it serves the solver as a start only, it may be computed
for one part of a long motion after the other, and for fewer frames a second than there are.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cholesky, solve_triangular

from pacmo_core.interaction_mesh.energy import (
    QuadraticEnergy,
    ancestor_bones,
    energy_target,
    hessian_product,
)
from pacmo_core.interaction_mesh.factorisation import (
    couple_next,
    diagonal_blocks,
    pair_frames,
    temporal_coupling,
)
from pacmo_core.interaction_mesh.linear_algebra import batched_product
from pacmo_core.interaction_mesh.scene import Array, Scene, Single

# Frames a second, about, for which answers are computed: with half as many, single bones start so
# far off that they end 3 % above the least energy.
RESPONSE_FPS = 30
# Such frames of a part, and of its neighbours that are looked at beside it.
SEGMENT_FRAMES = 480
OVERLAP_FRAMES = 40


@dataclass(frozen=True)
class LinearResponse:
    """What a bone of twice its length would do, were the answer linear.

    Parameters
    ----------
    leap : frames from one of the F for which this is known to the next
    turns : (F, E, 3, E) float32 metres, by which the ends of bones go sideways
    tensions : (F, E, E) float32, the forces along bones
    """

    leap: int
    turns: Single
    tensions: Single

    def summed(self, vectors: Array, scales: Array, bearing: Single) -> Single:
        """``(T, E, 3, V)`` metres: bones turned and pulled longer by what bears on them.

        Parameters
        ----------
        vectors : (T, E, 3) metres, the source's bones
        scales : (V, E)
        bearing : (T, E, 1), penalties
        """
        source = vectors.astype(np.float32)
        growth = np.ascontiguousarray(scales.T - 1).astype(np.float32)
        turned = batched_product(self.turns.reshape(-1, len(growth)), growth)
        bones = self._between(turned.reshape(*self.turns.shape[:3], -1), len(source))
        bones += source[..., None] * (1 + growth)[:, None]
        lengths = np.linalg.norm(source, axis=-1)[..., None] * (1 + growth)
        borne = batched_product(self.tensions.reshape(-1, len(growth)), growth)
        borne = self._between(borne.reshape(*self.tensions.shape[:2], -1), len(source))
        lengths += borne / bearing
        bones *= (lengths / np.sqrt(np.einsum("tecv,tecv->tev", bones, bones)))[:, :, None]
        return bones

    def _between(self, known: Single, n_frames: int) -> Single:
        """Fill in frames between those for which something is known, (F, ...)."""
        if self.leap == 1:
            return known
        before, beyond = np.divmod(np.arange(n_frames), self.leap)
        after = np.minimum(before + 1, len(known) - 1)
        share = (beyond / self.leap).astype(np.float32).reshape(-1, *[1] * (known.ndim - 1))
        found: Single = known[before]
        found += share * (known[after] - found)
        return found


def linear_response(scene: Scene, energy: QuadraticEnergy) -> LinearResponse:
    """Compute the answers to every bone, part by part."""
    leap = max(1, round(scene.fps / RESPONSE_FPS))
    n_frames, n_bones = -(-len(scene.vectors) // leap), scene.vectors.shape[1]
    turns = np.zeros((n_frames, n_bones, 3, n_bones), dtype=np.float32)
    tensions = np.zeros((n_frames, n_bones, n_bones), dtype=np.float32)
    for first in range(0, n_frames, SEGMENT_FRAMES):
        begin, end = max(0, first - OVERLAP_FRAMES), first + SEGMENT_FRAMES + OVERLAP_FRAMES
        part = _segment_response(scene, energy, slice(begin * leap, end * leap, leap))
        own = slice(first - begin, first - begin + SEGMENT_FRAMES)
        turns[first : first + SEGMENT_FRAMES], tensions[first : first + SEGMENT_FRAMES] = (
            x[own] for x in part
        )
    return LinearResponse(leap, turns, tensions)


def _segment_response(scene: Scene, whole: QuadraticEnergy, frames: slice) -> tuple[Single, Single]:
    """Give turns and tensions of some frames."""
    energy, vectors = whole.part(frames), scene.vectors[frames].astype(np.float32)
    n_bones = vectors.shape[1]
    free = reduced_basis(scene, vectors)
    # Each bone twice as long where it points, all else in place.
    grown = free.reach[:, None, :n_bones] * vectors.transpose(0, 2, 1)[:, None]
    pull = energy_target(energy, np.eye(n_bones) + 1).astype(np.float32)
    pull = apply_matrices(energy.laplacians.transpose(0, 2, 1).astype(np.float32), pull)
    right = free.gather(pull - hessian_product(energy, grown))
    moves = free.vectors(solve_reduced(energy, free, right))
    left = pull - hessian_product(energy, grown + apply_matrices(free.reach, moves))
    left = apply_matrices(free.reach.T[:n_bones], left)
    along = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return moves[:, :n_bones], np.einsum("tec,tecv->tev", along, left)


# FROM """What may move near the source: bones that turn, roots that go; and the least energy in these."""
Floats = NDArray[np.floating]


@dataclass(frozen=True)
class ReducedBasis:
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
        carried = apply_matrices(self.reach.T, values)[:, self.bones]
        gathered: Single = np.einsum("tmc,tmcv->tmv", self.ways, carried)
        return gathered

    def vectors(self, values: Single) -> Single:
        """Turn moves (T, M, V) into those of bones and roots, (T, E + 2, 3, V)."""
        first = np.flatnonzero(np.diff(self.bones, prepend=-1))
        return np.add.reduceat(self.ways[..., None] * values[:, :, None], first, axis=1)


def apply_matrices(matrices: Single, values: Single) -> Single:
    """Multiply (T, R, N) or (R, N) into (T, N, 3, V)."""
    product = matrices @ values.reshape(*values.shape[:2], -1)
    return product.reshape(*product.shape[:2], *values.shape[2:])


def reduced_basis(scene: Scene, vectors: Single) -> ReducedBasis:
    """Let bones (T, E, 3) turn, and both roots go anywhere."""
    n_frames, n_bones, _ = vectors.shape
    aside = np.eye(3, dtype=np.float32)[np.abs(vectors).argmin(axis=-1)]
    first = np.cross(vectors, aside)
    second = np.cross(vectors, first)
    across = np.stack([first, second], axis=2).reshape(n_frames, 2 * n_bones, 3)
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    anywhere = np.broadcast_to(np.tile(np.eye(3, dtype=np.float32), (2, 1)), (n_frames, 6, 3))
    roots = np.repeat(np.eye(2), scene.n_joints, axis=0)
    return ReducedBasis(
        bones=np.repeat(np.arange(n_bones + 2), [2] * n_bones + [3, 3]),
        ways=np.concatenate([across, anywhere], axis=1),
        reach=np.concatenate([ancestor_bones(scene), roots], axis=1).astype(np.float32),
    )


def solve_reduced(energy: QuadraticEnergy, free: ReducedBasis, right: Single) -> Single:
    """Solve for the moves (T, M, V) of least energy by block Cholesky.

    In float32, twice as fast; in float64 where the anchor, which alone holds the scene as a whole,
    is lost in the rounding of the rest.
    """
    try:
        return _block_cholesky_solve(energy, free, right).astype(np.float32, copy=False)
    except LinAlgError:
        return _block_cholesky_solve(energy, free, right.astype(np.float64)).astype(np.float32)


def _block_cholesky_solve(energy: QuadraticEnergy, free: ReducedBasis, right: Floats) -> Floats:
    """Compute in the precision of what is given.

    Raises
    ------
    LinAlgError
        If a pivot is not positive.
    """
    paired = pair_frames(right)
    solved = paired.reshape(len(paired), -1, right.shape[-1]).copy()
    pivots: list[Floats] = []
    ties: list[Floats] = []
    for number, (block, beyond) in enumerate(_reduced_blocks(energy, free)):
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


def _reduced_blocks(energy: QuadraticEnergy, free: ReducedBasis) -> Iterator[tuple[Array, Array]]:
    """Give H between the freedoms of two frames, and from these to those of the next two."""
    time, count = temporal_coupling(energy), len(free.bones)
    ways = pair_frames(free.ways.astype(np.float64)).reshape(-1, 2 * count, 3)
    heights = pair_frames(np.sqrt(energy.stance_height * energy.held)).reshape(len(ways), -1)
    reach = np.kron(np.eye(2), free.reach).astype(np.float64)
    rows = np.concatenate([free.bones, free.bones + free.reach.shape[1]])
    for number, flat in enumerate(diagonal_blocks(energy, time, None)):
        here, height = ways[number], heights[number]
        block = _scale_by_directions(reach.T @ flat @ reach, rows, here, here)
        standing = np.flatnonzero(height)
        raised = height[standing, None] * reach[standing][:, rows] * here[:, 1]
        block += raised.T @ raised
        # A frame that only fills up the last block has no ways to go.
        idle = np.flatnonzero(~here.any(axis=1))
        block[idle, idle] = 1
        if number + 1 < len(ways):
            tied = reach.T @ couple_next(time, reach, 2 * number)
            yield block, _scale_by_directions(tied, rows, ways[number + 1], here)
        else:
            yield block, np.zeros_like(block)


def _scale_by_directions(
    values: Array, rows: NDArray[np.intp], ways: Array, others: Array
) -> Array:
    """Give freedoms the entries of their bones, as far as their ways agree."""
    found: Array = values.take(rows[:, None] * len(values) + rows)
    found *= ways @ others.T
    return found
