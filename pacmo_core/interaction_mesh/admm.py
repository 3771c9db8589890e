"""The solver: alternating directions, many bodies at once.

Least E(U) with every bone of its length, split into a linear step (all frames and joints at once,
through one factorisation) and a local one (each bone for itself: pull it to its length). Boyd et
al. (2011), *Distributed optimization and statistical learning via the alternating direction method
of multipliers*, section 3; over-relaxed, section 3.4.3. The multiplier is kept as ``point - own``
of Douglas and Rachford's form: one state where the textbook has two.

Directions stand in the order x, z, y, so that the two that share a factorisation lie together, and
the local step runs on a block's frames while they are still in the processor's cache.
"""

from dataclasses import dataclass

import numpy as np

from pacmo_core.interaction_mesh.blocks import AXES, Work, in_pairs
from pacmo_core.interaction_mesh.factor import Factor
from pacmo_core.interaction_mesh.rows import Rows
from pacmo_core.interaction_mesh.scene import Array, Single


@dataclass
class State:
    """What goes from one iteration to the next; K blocks of two frames, V bodies.

    Parameters
    ----------
    right : (K, 2N, 3V) float32, right-hand side of the linear step
    change : (K, 2N, 3V) float32, its answer
    point : (K, 2, R, 3V) float32, the differences before the local step, multiplier included
    own : (K, 2, R, 3V) float32, the same after it: of the wanted lengths
    """

    right: Single
    change: Single
    point: Single
    own: Single


@dataclass(frozen=True)
class Solution:
    """What the solver gives; directions in the order of ``AXES``.

    Parameters
    ----------
    change : (2K, N, 3, V) float32, metres
    bones : (2K, E, 3, V) float32, metres, after the local step
    step : (V,) metres, by how much the last iteration still moved a bone's end, root mean square
    """

    change: Single
    bones: Single
    step: Array


class Solver:
    """One source, one penalty; ``solve`` for any number of bodies.

    Parameters
    ----------
    factor : of the energy with the rows' penalties
    rows : what is held
    n_bones : how many of the rows are bones; the others are pairs to keep apart
    relaxation : 1 to 2
    """

    def __init__(self, factor: Factor, rows: Rows, *, n_bones: int, relaxation: float) -> None:
        self._factor, self._relaxation, self._n_bones = factor, relaxation, n_bones
        self._n_blocks = len(factor.across)
        n_rows, n_points = rows.matrix.shape[1:]
        matrix = in_pairs(rows.matrix) if len(rows.matrix) > 1 else rows.matrix[None]
        self._gather = matrix.astype(np.float32)
        spread = (rows.weights[:, None] * matrix).swapaxes(-1, -2)
        self._spread = np.ascontiguousarray(spread, dtype=np.float32)
        # A frame that only fills up the last block has no bones; any direction serves it.
        source = in_pairs(rows.source[..., AXES])
        self._source = source.astype(np.float32)[..., None]
        self._lengths = np.linalg.norm(source[:, :, :n_bones], axis=-1)[..., None].astype(
            np.float32
        )
        self._least = in_pairs(rows.least)[..., None].astype(np.float32)
        self._shape = (2, n_rows, n_points)

    def solve(self, pull: Single, scales: Array, n_iterations: int) -> Solution:
        """Iterate from the source with its bones scaled.

        Parameters
        ----------
        pull : (K, 2N, 3V) float32, the energy's own right-hand side
        scales : (V, E)
        n_iterations : at least 1

        """
        n_bodies = len(scales)
        state = self._start(pull, scales)
        work = Work(self._shape, n_bodies, np.ascontiguousarray(scales.T, dtype=np.float32))
        before = state.point
        for number in range(n_iterations):
            if number + 1 == n_iterations:
                before = state.point.copy()
            self._forward(state, work)
            self._backward(state, work, pull)
        _, n_rows, n_points = self._shape
        change = state.change.reshape(-1, n_points, 3, n_bodies)
        bones = state.own.reshape(-1, n_rows, 3, n_bodies)[:, : self._n_bones]
        step = (state.point - before).reshape(-1, n_bodies)
        return Solution(change, bones, np.sqrt(np.square(step).mean(axis=0, dtype=np.float64)))

    def _start(self, pull: Single, scales: Array) -> State:
        grown = np.ones((self._shape[1], len(scales)), dtype=np.float32)
        grown[: self._n_bones] = scales.T
        own = (self._source * grown[:, None]).reshape(*self._source.shape[:3], -1)
        state = State(pull.copy(), np.zeros_like(pull), own.copy(), own)
        source = np.broadcast_to(self._source, (*self._source.shape[:-1], len(scales)))
        offset = own - source.reshape(own.shape)
        state.right += (self._spread @ offset).reshape(pull.shape)
        return state

    def _forward(self, state: State, work: Work) -> None:
        """Eliminate: ``w_k = S_k^-1 (b_k - C_k-1 w_k-1)``."""
        split, ties = 2 * work.n_bodies, self._factor
        for block in range(self._n_blocks):
            right, solved = state.right[block], state.change[block]
            if block:
                self._tie(state.change[block - 1], 2 * block - 2, work.tied)
                np.subtract(right, work.tied, out=right)
            np.matmul(ties.across[block], right[:, :split], out=solved[:, :split])
            np.matmul(ties.upright[block], right[:, split:], out=solved[:, split:])

    def _backward(self, state: State, work: Work, pull: Single) -> None:
        """Substitute, ``U_k = w_k - S_k^-1 C_k^T U_k+1``, and take the local step."""
        split, ties = 2 * work.n_bodies, self._factor
        for block in reversed(range(self._n_blocks)):
            change, moved = state.change[block], work.moved
            if block + 1 < self._n_blocks:
                self._tie_back(state.change[block + 1], 2 * block, work.tied)
                np.matmul(ties.across[block], work.tied[:, :split], out=moved[:, :split])
                np.matmul(ties.upright[block], work.tied[:, split:], out=moved[:, split:])
                np.subtract(change, moved, out=change)
            self._local_step(state, work, block)
            which = block if len(self._spread) > 1 else 0
            right = state.right[block]
            np.matmul(self._spread[which], work.held, out=right.reshape(work.halves))
            np.add(right, pull[block], out=right)

    def _local_step(self, state: State, work: Work, block: int) -> None:
        """Pull every difference to where it is allowed; ``held`` gets what the rest must meet."""
        which = block if len(self._gather) > 1 else 0
        held, point, own = work.held, state.point[block], state.own[block]
        source = self._source[block]
        np.matmul(self._gather[which], state.change[block].reshape(work.halves), out=held)
        np.add(work.vectors(held), source, out=work.vectors(held))
        np.subtract(held, own, out=held)
        np.multiply(held, self._relaxation, out=held)
        np.add(point, held, out=point)
        np.multiply(point, point, out=held)
        squares = work.vectors(held)
        share = np.add(squares[:, :, 0], squares[:, :, 1], out=work.share)
        np.add(share, squares[:, :, 2], out=share)
        np.sqrt(share, out=share)
        np.maximum(share, np.float32(1e-9), out=share)
        bones = share[:, : self._n_bones]
        np.divide(np.multiply(self._lengths[block], work.scales, out=work.wanted), bones, out=bones)
        pairs = share[:, self._n_bones :]
        np.maximum(np.divide(self._least[block], pairs, out=pairs), np.float32(1), out=pairs)
        np.multiply(work.vectors(point), share[:, :, None], out=work.vectors(own))
        np.multiply(own, np.float32(2), out=held)
        np.subtract(held, point, out=held)
        np.subtract(work.vectors(held), source, out=work.vectors(held))

    def _tie(self, rows: Single, frame: int, out: Single) -> None:
        """Multiply by C_k: from the frames of a block to those of the next."""
        near, far = self._factor.next_frame, self._factor.next_but_one
        n_points = self._shape[2]
        upper, lower = rows[:n_points], rows[n_points:]
        np.multiply(lower, near[frame + 1], out=out[:n_points])
        np.multiply(upper, far[frame], out=out[n_points:])
        np.add(out[:n_points], out[n_points:], out=out[:n_points])
        np.multiply(lower, far[frame + 1], out=out[n_points:])

    def _tie_back(self, rows: Single, frame: int, out: Single) -> None:
        """Multiply by the transpose of C_k: from the next block's frames to a block's."""
        near, far = self._factor.next_frame, self._factor.next_but_one
        n_points = self._shape[2]
        upper, lower = rows[:n_points], rows[n_points:]
        np.multiply(upper, near[frame + 1], out=out[n_points:])
        np.multiply(lower, far[frame + 1], out=out[:n_points])
        np.add(out[n_points:], out[:n_points], out=out[n_points:])
        np.multiply(upper, far[frame], out=out[:n_points])
