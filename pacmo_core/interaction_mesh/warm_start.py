"""The warm start of ADMM: the linear response of the motion to the scale of each bone.

To first order the solution is linear in the bone scales: the minimum of E(U) where every bone
reaches its length along its own direction. The free variables are two rotations per bone and three
translations per root, a reduced basis in which one block Cholesky factorisation (two frames per
block) gives the response to every bone. The warm start of any body is a sum of these responses.
Being a start only, it is computed at a reduced frame rate.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cholesky, solve_triangular

from pacmo_core.interaction_mesh.body_parts import ancestor_bones
from pacmo_core.interaction_mesh.energy import QuadraticEnergy, energy_rhs, hessian_product
from pacmo_core.interaction_mesh.factorisation import (
    couple_next,
    diagonal_blocks,
    temporal_coupling,
)
from pacmo_core.interaction_mesh.linear_algebra import batched_product, pair_frames
from pacmo_core.interaction_mesh.scene import Array, Scene, Single

Floats = NDArray[np.floating]

# Approximate frame rate of the responses. At half of it, variations of single bones end 3.5 % above
# the minimum of the energy.
RESPONSE_FPS = 30


@dataclass(frozen=True)
class LinearResponse:
    """The linear response to the scale of each bone, extrapolated to a bone of twice its length.

    Parameters
    ----------
    stride : source frames between two of the F frames of the response
    displacements : (F, E, 3, E) float32 metres, change of each bone vector across the bone, per
        scaled bone
    tensions : (F, E, E) float32, force along each bone, per scaled bone
    """

    stride: int
    displacements: Single
    tensions: Single

    def warm_start(self, vectors: Array, scales: Array, penalties: Single) -> Single:
        """Return bone vectors with the target lengths plus dual variables: ``(T, E, 3, V)`` metres.

        Parameters
        ----------
        vectors : (T, E, 3) metres, bone vectors of the source
        scales : (V, E)
        penalties : (T, E, 1), of ADMM; a tension divided by its penalty is the dual variable
        """
        source = vectors.astype(np.float32)
        growth = np.ascontiguousarray(scales.T - 1).astype(np.float32)
        across = batched_product(self.displacements.reshape(-1, len(growth)), growth)
        bones = self._interpolate(across.reshape(*self.displacements.shape[:3], -1), len(source))
        bones += source[..., None] * (1 + growth)[:, None]
        lengths = np.linalg.norm(source, axis=-1)[..., None] * (1 + growth)
        tensions = batched_product(self.tensions.reshape(-1, len(growth)), growth)
        tensions = self._interpolate(tensions.reshape(*self.tensions.shape[:2], -1), len(source))
        lengths += tensions / penalties
        bones *= (lengths / np.sqrt(np.einsum("tecv,tecv->tev", bones, bones)))[:, :, None]
        return bones

    def _interpolate(self, values: Single, n_frames: int) -> Single:
        """Interpolate linearly from the frames of the response, (F, ...), to all frames."""
        if self.stride == 1:
            return values
        before, offset = np.divmod(np.arange(n_frames), self.stride)
        after = np.minimum(before + 1, len(values) - 1)
        fraction = (offset / self.stride).astype(np.float32)
        result: Single = values[before]
        result += fraction.reshape(-1, *[1] * (values.ndim - 1)) * (values[after] - result)
        return result


def linear_response(scene: Scene, whole_energy: QuadraticEnergy) -> LinearResponse:
    """Compute the linear response to the scale of every bone."""
    stride = max(1, round(scene.fps / RESPONSE_FPS))
    energy = whole_energy.subsample(stride)
    vectors = scene.bone_vectors[::stride].astype(np.float32)
    n_bones = vectors.shape[1]
    basis = reduced_basis(scene, vectors)
    # Each bone at twice its length along its direction, all other bones unchanged.
    stretched = basis.carried_joints[:, None, :n_bones] * vectors.transpose(0, 2, 1)[:, None]
    rhs = energy_rhs(energy, np.eye(n_bones) + 1)
    reduced_rhs = basis.project(rhs - hessian_product(energy, stretched))
    moves = basis.expand(solve_reduced(energy, basis, reduced_rhs))
    displacement = stretched + apply_matrices(basis.carried_joints, moves)
    force = rhs - hessian_product(energy, displacement)
    force = apply_matrices(basis.carried_joints.T[:n_bones], force)
    along = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return LinearResponse(stride, moves[:, :n_bones], np.einsum("tec,tecv->tev", along, force))


@dataclass(frozen=True)
class ReducedBasis:
    """Basis of the motions that keep all bone lengths to first order, M = 2E + 6 per frame.

    Parameters
    ----------
    bones : (M,), the bone of a basis vector or, numbered after the bones, its root
    directions : (T, M, 3) unit vectors
    carried_joints : (N, E + 2), ones where a bone or a root moves a joint
    """

    bones: NDArray[np.intp]
    directions: Single
    carried_joints: Single

    def project(self, forces: Single) -> Single:
        """Project forces on joints, (T, N, 3, V), on the basis: (T, M, V)."""
        on_bones = apply_matrices(self.carried_joints.T, forces)[:, self.bones]
        projected: Single = np.einsum("tmc,tmcv->tmv", self.directions, on_bones)
        return projected

    def expand(self, coefficients: Single) -> Single:
        """Turn coefficients (T, M, V) into changes of bones and roots, (T, E + 2, 3, V)."""
        first = np.flatnonzero(np.diff(self.bones, prepend=-1))
        moves = self.directions[..., None] * coefficients[:, :, None]
        return np.add.reduceat(moves, first, axis=1)


def apply_matrices(matrices: Single, values: Single) -> Single:
    """Multiply (T, R, N) or (R, N) with (T, N, 3, V)."""
    product = matrices @ values.reshape(*values.shape[:2], -1)
    return product.reshape(*product.shape[:2], *values.shape[2:])


def reduced_basis(scene: Scene, vectors: Single) -> ReducedBasis:
    """Return two rotations of each bone (T, E, 3) and three translations of each root."""
    n_frames, n_bones, _ = vectors.shape
    helper = np.eye(3, dtype=np.float32)[np.abs(vectors).argmin(axis=-1)]
    first = np.cross(vectors, helper)
    second = np.cross(vectors, first)
    across = np.stack([first, second], axis=2).reshape(n_frames, 2 * n_bones, 3)
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    axes = np.broadcast_to(np.tile(np.eye(3, dtype=np.float32), (2, 1)), (n_frames, 6, 3))
    roots = np.repeat(np.eye(2), scene.n_joints, axis=0)
    return ReducedBasis(
        bones=np.repeat(np.arange(n_bones + 2), [2] * n_bones + [3, 3]),
        directions=np.concatenate([across, axes], axis=1),
        carried_joints=np.concatenate([ancestor_bones(scene), roots], axis=1).astype(np.float32),
    )


def solve_reduced(energy: QuadraticEnergy, basis: ReducedBasis, rhs: Single) -> Single:
    """Solve for the coefficients (T, M, V) of minimal energy by block Cholesky.

    In float32, which takes half the time; in float64 if the regularisation, which alone fixes the
    position of the scene, is lost to rounding.
    """
    try:
        return _block_cholesky_solve(energy, basis, rhs).astype(np.float32, copy=False)
    except LinAlgError:
        return _block_cholesky_solve(energy, basis, rhs.astype(np.float64)).astype(np.float32)


def _block_cholesky_solve(energy: QuadraticEnergy, basis: ReducedBasis, rhs: Floats) -> Floats:
    """Solve in the precision of the right-hand side.

    Raises
    ------
    LinAlgError
        If a pivot is not positive definite.
    """
    paired = pair_frames(rhs)
    solution = paired.reshape(len(paired), -1, rhs.shape[-1]).copy()
    pivots: list[Floats] = []
    couplings: list[Floats] = []
    for number, (block, coupling) in enumerate(_reduced_blocks(energy, basis)):
        pivot = block.astype(rhs.dtype)
        if number:
            pivot -= couplings[-1].T @ couplings[-1]
            solution[number] -= couplings[-1].T @ solution[number - 1]
        pivot = cholesky(pivot, lower=True, overwrite_a=True, check_finite=False)
        solution[number] = _triangular(pivot, solution[number])
        pivots.append(pivot)
        couplings.append(_triangular(pivot, coupling.T.astype(rhs.dtype)))
    for number in reversed(range(len(solution))):
        if number + 1 < len(solution):
            solution[number] -= couplings[number] @ solution[number + 1]
        solution[number] = _triangular(pivots[number], solution[number], transposed=True)
    return solution.reshape(-1, *rhs.shape[1:])[: len(rhs)]


def _triangular(pivot: Floats, values: Floats, *, transposed: bool = False) -> Floats:
    trans: Literal["N", "T"] = "T" if transposed else "N"
    solved: Floats = solve_triangular(pivot, values, trans=trans, lower=True, check_finite=False)
    return solved


def _reduced_blocks(energy: QuadraticEnergy, basis: ReducedBasis) -> Iterator[tuple[Array, Array]]:
    """Yield H in the basis of two frames, and between that and the basis of the next two."""
    coupling, size = temporal_coupling(energy), len(basis.bones)
    directions = pair_frames(basis.directions.astype(np.float64)).reshape(-1, 2 * size, 3)
    heights = pair_frames(np.sqrt(energy.height_weights))
    heights = heights.reshape(len(directions), -1)
    carried = np.kron(np.eye(2), basis.carried_joints).astype(np.float64)
    rows = np.concatenate([basis.bones, basis.bones + basis.carried_joints.shape[1]])
    for number, horizontal in enumerate(diagonal_blocks(energy, coupling, None)):
        here, height = directions[number], heights[number]
        block = _scale_by_directions(carried.T @ horizontal @ carried, rows, here, here)
        supports = np.flatnonzero(height)
        vertical = height[supports, None] * carried[supports][:, rows] * here[:, 1]
        block += vertical.T @ vertical
        # A frame that only pads the last block has zero directions.
        empty = np.flatnonzero(~here.any(axis=1))
        block[empty, empty] = 1
        if number + 1 < len(directions):
            coupled = carried.T @ couple_next(coupling, carried, 2 * number)
            yield block, _scale_by_directions(coupled, rows, directions[number + 1], here)
        else:
            yield block, np.zeros_like(block)


def _scale_by_directions(
    values: Array, rows: NDArray[np.intp], directions: Array, others: Array
) -> Array:
    """Expand a matrix on bones to basis vectors, times the inner products of their directions."""
    expanded: Array = values.take(rows[:, None] * len(values) + rows)
    expanded *= directions @ others.T
    return expanded
