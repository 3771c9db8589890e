"""One factorisation a source, which serves every body that its motion is given to.

``H + penalties`` ties a frame to the two before it. Two frames a block make it block tridiagonal,
with ties that are diagonal between blocks, and block elimination needs only the inverse of each
pivot. Ground tells height from the other two directions, hence two stacks of pivots.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import tee
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky
from scipy.linalg.lapack import dpotri

from pacmo_core.interaction_mesh.energy import QuadraticEnergy
from pacmo_core.interaction_mesh.scene import Array, Scene, Single


# FROM """The differences of points that penalties hold: bones to their lengths, pairs apart."""
@dataclass(frozen=True)
class Constraints:
    """Differences of two points; bones come first.

    Parameters
    ----------
    pairs : (T, R, 2), the second point less the first
    weights : (T, R), penalties
    source : (T, R, 3) metres, the differences in the source
    least : (T, R - E) metres, how far apart the pairs must stay
    """

    pairs: NDArray[np.intp]
    weights: Array
    source: Array
    least: Array


def bone_constraints(scene: Scene, weights: Array) -> Constraints:
    """Hold bones alone, with weights (T, E)."""
    n_frames = len(scene.points)
    pairs = np.broadcast_to(scene.bones, (n_frames, *scene.bones.shape))
    return Constraints(pairs, weights, scene.vectors, np.zeros((n_frames, 0)))


def add_separation_constraints(
    scene: Scene, bones: Constraints, apart: float, n_pairs: int, clearance: float
) -> Constraints:
    """Hold the closest pairs of every frame apart too, each as far as in the source at most.

    Parameters
    ----------
    apart : penalty
    n_pairs : a frame
    clearance : metres that joints of two bodies keep, where the source does
    """
    pairs = closest_pairs(scene, n_pairs)
    first, second = (
        np.take_along_axis(scene.points, pairs[..., end, None], axis=1) for end in (0, 1)
    )
    source = second - first
    return Constraints(
        pairs=np.concatenate([bones.pairs, pairs], axis=1),
        weights=np.concatenate([bones.weights, np.full(pairs.shape[:2], apart)], axis=1),
        source=np.concatenate([bones.source, source], axis=1),
        least=np.linalg.norm(source, axis=-1).clip(max=clearance),
    )


def closest_pairs(scene: Scene, n_pairs: int) -> NDArray[np.intp]:
    """``(T, P, 2)``: the pairs of points, one of either body, that are closest in each frame."""
    n_a, n_b = scene.n_joints
    a, b = scene.points[:, :n_a, None], scene.points[:, None, n_a:]
    distances = np.linalg.norm(a - b, axis=-1).reshape(len(a), -1)
    found = np.argsort(distances, axis=1, kind="stable")[:, :n_pairs]
    return np.stack([found // n_b, n_a + found % n_b], axis=-1)


def difference_matrices(pairs: NDArray[np.intp], n_points: int) -> Array:
    """``(..., R, N)``: the matrix of -1 and 1 that takes points to their differences."""
    everyone = np.arange(n_points)
    first, second = ((pairs[..., end, None] == everyone).astype(np.float64) for end in (0, 1))
    difference: Array = second - first
    return difference


# FROM """Frames in pairs, as block elimination takes them, and H between them."""
Values = TypeVar("Values", Array, Single, NDArray[np.intp])

# From x, y, z to the order of the solver, in which the two directions that share a factorisation
# lie together. Its own inverse.
AXIS_ORDER = [0, 2, 1]


@dataclass(frozen=True)
class TemporalCoupling:
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


def temporal_coupling(energy: QuadraticEnergy) -> TemporalCoupling:
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
    return TemporalCoupling(same, after, skip)


def diagonal_blocks(
    energy: QuadraticEnergy, time: TemporalCoupling, rows: Constraints | None
) -> Iterator[Array]:
    """Give what H and the penalties have within each block, (2N, 2N), height apart."""
    n_frames, n_points = energy.held.shape
    everyone = np.arange(n_points)
    for first in range(0, len(time.same), 2):
        block = np.zeros((2 * n_points, 2 * n_points))
        frames = slice(first, min(first + 2, n_frames))
        inside = energy.within(frames)
        if rows is not None:
            matrix = difference_matrices(rows.pairs[frames], n_points)
            inside += matrix.transpose(0, 2, 1) @ (rows.weights[frames, :, None] * matrix)
        for half, values in enumerate(inside):
            part = slice(half * n_points, (half + 1) * n_points)
            block[part, part] = values
        here = np.arange(2 * n_points)
        block[here, here] += time.same[first : first + 2].reshape(-1)
        block[everyone, n_points + everyone] += time.next_frame[first]
        block[n_points + everyone, everyone] += time.next_frame[first]
        yield block


def couple_next(time: TemporalCoupling, rows: Array, first: int) -> Array:
    """Multiply rows (2N, C) of the frames ``first``, ``first + 1`` into those of the next two."""
    upper, lower = np.split(rows, 2)
    skip = time.next_but_one
    top = skip[first] * upper + time.next_frame[first + 1][:, None] * lower
    return np.concatenate([top, skip[first + 1] * lower])


def couple_previous(time: TemporalCoupling, rows: Array, first: int) -> Array:
    """Multiply by the transpose of ``tie``: from the next two frames into these."""
    upper, lower = np.split(rows, 2)
    skip = time.next_but_one
    bottom = time.next_frame[first + 1][:, None] * upper + skip[first + 1] * lower
    return np.concatenate([skip[first] * upper, bottom])


def pair_frames(rows: Values) -> Values:
    """Turn (T, ...) into (K, 2, ...); zeros fill up an odd end."""
    if len(rows) % 2:
        rows = np.concatenate([rows, np.zeros_like(rows[:1])])
    paired: Values = rows.reshape(len(rows) // 2, 2, *rows.shape[1:])
    return paired


@dataclass(frozen=True)
class Factorisation:
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


def factorise(energy: QuadraticEnergy, rows: Constraints) -> Factorisation:
    """Eliminate block by block in float64."""
    time = temporal_coupling(energy)
    size = 2 * time.same.shape[1]
    across = np.zeros((len(time.same) // 2, size, size), dtype=np.float32)
    upright = np.zeros_like(across)
    flat, same = tee(diagonal_blocks(energy, time, rows))
    both = zip(
        _inverse_pivots(flat, time),
        _inverse_pivots(_add_height_term(same, energy), time),
        strict=True,
    )
    for number, (level, high) in enumerate(both):
        across[number], upright[number] = level, high
    return Factorisation(
        across,
        upright,
        time.next_frame.astype(np.float32)[..., None],
        time.next_but_one.astype(np.float32),
    )


def stiffness(energy: QuadraticEnergy, scene: Scene) -> Array:
    """``(T, E)``: the force a metre with which the energy alone holds a bone's end to its parent.

    ``1 / (a^T H^-1 a)`` with a the difference of the two points in one frame, in height, which the
    ground holds harder: penalties in proportion to it suit hands in contact, feet on the ground and
    heads in the air alike.
    """
    time = temporal_coupling(energy)
    loose = _compliance(_add_height_term(diagonal_blocks(energy, time, None), energy), time, scene)
    stiff: Array = 1 / loose[: len(energy.held)]
    return stiff


def _compliance(blocks: Iterable[Array], time: TemporalCoupling, scene: Scene) -> Array:
    """``(2K, E)``: a^T H^-1 a.

    The blocks of the inverse on the diagonal follow from the pivots, last to first: Takahashi,
    Fagan and Chen (1973), *Formation of a sparse bus impedance matrix*.
    """
    pivots = [pivot.astype(np.float32) for pivot in _inverse_pivots(blocks, time)]
    n_points = time.same.shape[1]
    ends = np.concatenate([scene.bones, n_points + scene.bones]).T
    found = np.zeros((len(pivots), ends.shape[1]))
    block = pivots[-1].astype(np.float64)
    for number in reversed(range(len(pivots))):
        if number + 1 < len(pivots):
            pivot = pivots[number].astype(np.float64)
            half = couple_previous(time, block, 2 * number)
            block = pivot + pivot @ couple_previous(time, half.T, 2 * number) @ pivot
        parent, child = ends
        found[number] = block[child, child] + block[parent, parent] - 2 * block[child, parent]
    return found.reshape(2 * len(pivots), -1)


def _add_height_term(blocks: Iterable[Array], energy: QuadraticEnergy) -> Iterator[Array]:
    """Add what the ground has on height."""
    heights = energy.stance_height * pair_frames(energy.held)
    for block, height in zip(blocks, heights, strict=True):
        yield block + np.diag(height.reshape(-1))


def _inverse_pivots(blocks: Iterable[Array], time: TemporalCoupling) -> Iterator[Array]:
    """Invert ``S_k = H_kk - C_k-1 S_k-1^-1 C_k-1^T`` in turn."""
    size = 2 * time.same.shape[1]
    filled = np.zeros((size, size))
    for number, block in enumerate(blocks):
        inverse = _symmetric_inverse(block - filled)
        yield inverse
        filled = couple_next(time, couple_next(time, inverse, 2 * number).T, 2 * number)


def _symmetric_inverse(block: Array) -> Array:
    """Invert what is symmetric and positive, in two thirds of the time of a solver."""
    root = cholesky(block, lower=True, check_finite=False)
    lower, _ = dpotri(root, lower=1)
    inverse: Array = np.tril(lower) + np.tril(lower, -1).T
    return inverse
