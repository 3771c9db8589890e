"""The block Cholesky factorisation of a source, which serves all target bodies.

The matrix of ADMM's linear step is ``H + A^T P A``: H the energy's Hessian, A the differences of
points and the heights that are constrained, P their penalties. It couples a frame with the two
before it. With two frames per block it is block tridiagonal, its off-diagonal blocks C_k consist of
diagonal matrices, and block elimination needs only the inverse of each pivot S_k. Supports and the
floor act on heights alone, hence one stack of pivots for the horizontal directions and one for the
height.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import tee

import numpy as np
from scipy.linalg import cholesky
from scipy.linalg.lapack import dpotri

from pacmo_core.interaction_mesh.constraints import Floor, Rows
from pacmo_core.interaction_mesh.energy import QuadraticEnergy
from pacmo_core.interaction_mesh.linear_algebra import pair_frames
from pacmo_core.interaction_mesh.scene import Array, Scene, Single


@dataclass(frozen=True)
class TemporalCoupling:
    """The entries of H between positions of a joint at different times.

    They come from the acceleration and stance terms.

    Parameters
    ----------
    diagonal : (2K, N)
    lag_one : (2K, N), between a frame and the next
    lag_two : (2K,), between a frame and the next but one, the same for every joint
    """

    diagonal: Array
    lag_one: Array
    lag_two: Array


def temporal_coupling(energy: QuadraticEnergy) -> TemporalCoupling:
    """Return the entries; a frame that pads the last block has a diagonal of ones alone."""
    n_frames, n_points = energy.height_weights.shape
    size = n_frames + n_frames % 2
    diagonal, lag_one = np.zeros((size, n_points)), np.zeros((size, n_points))
    lag_two = np.zeros(size)
    n_accelerations = max(0, n_frames - 2)
    for shift, entry in enumerate((1, 4, 1)):
        diagonal[shift : n_accelerations + shift] += energy.acceleration * entry
    for shift in (0, 1):
        lag_one[shift : n_accelerations + shift] -= 2 * energy.acceleration
    lag_two[:n_accelerations] = energy.acceleration
    stance = energy.stance * energy.step_weights
    diagonal[: n_frames - 1] += stance
    diagonal[1:n_frames] += stance
    lag_one[: n_frames - 1] -= stance
    diagonal[n_frames:] = 1
    return TemporalCoupling(diagonal, lag_one, lag_two)


def diagonal_blocks(
    energy: QuadraticEnergy, coupling: TemporalCoupling, constraints: Rows | None
) -> Iterator[Array]:
    """Yield the diagonal blocks of ``H + A^T P A``, (2N, 2N), without heights alone."""
    n_frames, n_points = energy.height_weights.shape
    points = np.arange(n_points)
    for first in range(0, len(coupling.diagonal), 2):
        block = np.zeros((2 * n_points, 2 * n_points))
        frames = slice(first, min(first + 2, n_frames))
        hessians = energy.frame_hessians[frames].copy()
        if constraints is not None:
            matrix = constraints.matrices(frames, n_points)
            hessians += matrix.transpose(0, 2, 1) @ (
                constraints.penalties[frames, :, None] * matrix
            )
        for half, values in enumerate(hessians):
            rows = slice(half * n_points, (half + 1) * n_points)
            block[rows, rows] = values
        both = np.arange(2 * n_points)
        block[both, both] += coupling.diagonal[first : first + 2].reshape(-1)
        block[points, n_points + points] += coupling.lag_one[first]
        block[n_points + points, points] += coupling.lag_one[first]
        yield block


def couple_next(coupling: TemporalCoupling, rows: Array, first: int) -> Array:
    """Multiply rows (2N, C) of the frames ``first``, ``first + 1`` by C_k, to the next two."""
    upper, lower = np.split(rows, 2)
    lag_two = coupling.lag_two
    top = lag_two[first] * upper + coupling.lag_one[first + 1][:, None] * lower
    return np.concatenate([top, lag_two[first + 1] * lower])


def couple_previous(coupling: TemporalCoupling, rows: Array, first: int) -> Array:
    """Multiply rows (2N, C) of the frames after these two by C_k^T, to these two."""
    upper, lower = np.split(rows, 2)
    lag_two = coupling.lag_two
    bottom = coupling.lag_one[first + 1][:, None] * upper + lag_two[first + 1] * lower
    return np.concatenate([lag_two[first] * upper, bottom])


@dataclass(frozen=True)
class Factorisation:
    """The inverse pivots of K blocks of two frames; an odd end is padded with a frame.

    Parameters
    ----------
    horizontal, vertical : (K, 2N, 2N) float32, S_k^-1 of the horizontal directions and of height
    lag_one : (2K, N, 1) float32, entries of the matrix between a frame and the next
    lag_two : (2K,) float32, between a frame and the next but one, the same for every joint
    """

    horizontal: Single
    vertical: Single
    lag_one: Single
    lag_two: Single


def factorise(energy: QuadraticEnergy, rows: Rows, floor: Floor) -> Factorisation:
    """Eliminate block by block in float64, and store the inverse pivots in float32."""
    coupling = temporal_coupling(energy)
    height_weights = energy.height_weights.copy()
    height_weights[:, floor.joints] += floor.penalties
    size = 2 * coupling.diagonal.shape[1]
    horizontal = np.zeros((len(coupling.diagonal) // 2, size, size), dtype=np.float32)
    vertical = np.zeros_like(horizontal)
    blocks, same_blocks = tee(diagonal_blocks(energy, coupling, rows))
    pivots = zip(
        _inverse_pivots(blocks, coupling),
        _inverse_pivots(_add_heights(same_blocks, height_weights), coupling),
        strict=True,
    )
    for number, (across, upright) in enumerate(pivots):
        horizontal[number], vertical[number] = across, upright
    return Factorisation(
        horizontal,
        vertical,
        coupling.lag_one.astype(np.float32)[..., None],
        coupling.lag_two.astype(np.float32),
    )


def bone_stiffness(energy: QuadraticEnergy, scene: Scene) -> Array:
    """Return the stiffness with which the energy alone holds each bone's length, ``(T, E)``.

    ``1 / (a^T H^-1 a)`` with a the difference of the bone's ends in one frame, in height, where
    ground supports make it largest. Penalties relative to it suit hands in contact, feet on the
    ground and heads in the air alike.
    """
    coupling = temporal_coupling(energy)
    blocks = _add_heights(diagonal_blocks(energy, coupling, None), energy.height_weights)
    compliance = _compliance(blocks, coupling, scene)
    stiffness: Array = 1 / compliance[: len(energy.height_weights)]
    return stiffness


def _compliance(blocks: Iterable[Array], coupling: TemporalCoupling, scene: Scene) -> Array:
    """``(2K, E)``: a^T H^-1 a.

    The diagonal blocks of the inverse follow from the pivots, last to first: Takahashi, Fagan and
    Chen (1973), *Formation of a sparse bus impedance matrix*.
    """
    pivots = [pivot.astype(np.float32) for pivot in _inverse_pivots(blocks, coupling)]
    n_points = coupling.diagonal.shape[1]
    ends = np.concatenate([scene.bones, n_points + scene.bones]).T
    compliance = np.zeros((len(pivots), ends.shape[1]))
    block = pivots[-1].astype(np.float64)
    for number in reversed(range(len(pivots))):
        if number + 1 < len(pivots):
            pivot = pivots[number].astype(np.float64)
            half = couple_previous(coupling, block, 2 * number)
            block = pivot + pivot @ couple_previous(coupling, half.T, 2 * number) @ pivot
        parent, child = ends
        compliance[number] = block[child, child] + block[parent, parent] - 2 * block[child, parent]
    return compliance.reshape(2 * len(pivots), -1)


def _add_heights(blocks: Iterable[Array], weights: Array) -> Iterator[Array]:
    """Add what acts on heights alone, (T, N), to the blocks of the vertical direction."""
    for block, diagonal in zip(blocks, pair_frames(weights), strict=True):
        yield block + np.diag(diagonal.reshape(-1))


def _inverse_pivots(blocks: Iterable[Array], coupling: TemporalCoupling) -> Iterator[Array]:
    """Yield the inverses of ``S_k = H_kk - C_k-1 S_k-1^-1 C_k-1^T`` in turn."""
    size = 2 * coupling.diagonal.shape[1]
    update = np.zeros((size, size))
    for number, block in enumerate(blocks):
        inverse = _symmetric_inverse(block - update)
        yield inverse
        half = couple_next(coupling, inverse, 2 * number)
        update = couple_next(coupling, half.T, 2 * number)


def _symmetric_inverse(block: Array) -> Array:
    """Invert a symmetric positive definite matrix; a third faster than a general solver."""
    root = cholesky(block, lower=True, check_finite=False)
    lower, _ = dpotri(root, lower=1)
    inverse: Array = np.tril(lower) + np.tril(lower, -1).T
    return inverse
