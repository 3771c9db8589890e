"""The solver: alternating directions, many bodies at once.

Least E(U) with every bone of its length, split into a linear step (all frames and joints at once,
through one factorisation) and a local one (each bone for itself: pull it to its length). Boyd et
al. (2011), *Distributed optimization and statistical learning via the alternating direction method
of multipliers*, section 3; over-relaxed, section 3.4.3. In Douglas and Rachford's form one state,
the ``point``, stands for the textbook's two: its share ``s`` of the wanted length gives the bone,
``s point``, and what is left over the multiplier.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pacmo_core.interaction_mesh.blocks import AXES, in_pairs
from pacmo_core.interaction_mesh.factor import Factor
from pacmo_core.interaction_mesh.rows import Rows, differences
from pacmo_core.interaction_mesh.scene import Single
from pacmo_core.interaction_mesh.state import State, Work


@dataclass(frozen=True)
class Solver:
    """One source and its penalties, which serve any number of bodies; K blocks of two frames.

    Parameters
    ----------
    factor : of the energy with the rows' penalties
    ends : two of (K, 2R), which of a block's 2N points each difference goes from, and to
    spread : (K, 2, N, R) float32, from differences back to points, times penalties
    source : (K, 2, R, 3, 1) float32 metres, the differences in the source
    lengths : (K, 2, E, 1) float32 metres, of bones in the source
    least : (K, 2, R - E, 1) float32 metres
    guarded : (T, R - E, 2), the pairs of points
    relaxation : 1 to 2
    """

    factor: Factor
    ends: tuple[NDArray[np.intp], NDArray[np.intp]]
    spread: Single
    source: Single
    lengths: Single
    least: Single
    guarded: NDArray[np.intp]
    relaxation: float

    def iterate(self, state: State, work: Work) -> None:
        """Take a linear and a local step."""
        for _ in self._forward(state, work):
            pass
        for block in self._backward(state, work):
            self._local_step(state, work, block)

    def settle(self, state: State) -> None:
        """Follow up a new ``point``: what it leaves to the linear step."""
        work = state.work(self.source.shape[2])
        for block in range(len(self.source)):
            self._pull(state, work, block)

    def _forward(self, state: State, work: Work) -> Iterator[int]:
        """Eliminate: ``w_k = S_k^-1 (b_k - C_k-1 w_k-1)``."""
        split, pivots = 2 * state.n_bodies, self.factor
        for block in range(len(self.source)):
            right, solved = state.right[block], state.change[block]
            if block:
                self._tie(state.change[block - 1], 2 * block - 2, work.tied)
                np.subtract(right, work.tied, out=right)
            np.matmul(pivots.across[block], right[:, :split], out=solved[:, :split])
            np.matmul(pivots.upright[block], right[:, split:], out=solved[:, split:])
            yield block

    def _backward(self, state: State, work: Work) -> Iterator[int]:
        """Substitute: ``U_k = w_k - S_k^-1 C_k^T U_k+1``."""
        split, pivots = 2 * state.n_bodies, self.factor
        last = len(self.source) - 1
        for block in range(last, -1, -1):
            change, moved = state.change[block], work.moved
            if block < last:
                self._tie_back(state.change[block + 1], 2 * block, work.tied)
                np.matmul(pivots.across[block], work.tied[:, :split], out=moved[:, :split])
                np.matmul(pivots.upright[block], work.tied[:, split:], out=moved[:, split:])
                np.subtract(change, moved, out=change)
            yield block

    def _local_step(self, state: State, work: Work, block: int) -> None:
        """Move the points by what the linear step and the lengths disagree, over-relaxed.

        It follows the linear step block by block, while the block is in the processor's cache.
        """
        held, other, point = work.held, work.other, state.point[block]
        np.take(state.change[block], self.ends[1][block], axis=0, out=work.rows(held), mode="clip")
        np.take(state.change[block], self.ends[0][block], axis=0, out=work.rows(other), mode="clip")
        np.subtract(held, other, out=held)
        np.add(held, self.source[block], out=held)
        np.multiply(state.share[block], np.float32(-self.relaxation), out=work.share)
        np.add(work.share, np.float32(1), out=work.share)
        np.multiply(held, np.float32(self.relaxation), out=held)
        if work.watched:
            other[:] = point
        np.multiply(point, work.share[:, :, None], out=point)
        np.add(point, held, out=point)
        if work.watched:
            np.subtract(other, point, out=other)
            np.multiply(other, other, out=other)
            # Row by row, in the same order whatever the number of columns.
            state.moved[:] += np.add.reduce(other.reshape(-1, state.n_bodies), axis=0)
        self._pull(state, work, block)

    def _pull(self, state: State, work: Work, block: int) -> None:
        """Pull every difference to where it is allowed, and say what the rest must meet."""
        held, point, share = work.held, state.point[block], state.share[block]
        n_bones = self.lengths.shape[2]
        np.multiply(point, point, out=held)
        np.add(held[:, :, 0], held[:, :, 1], out=share)
        np.add(share, held[:, :, 2], out=share)
        np.sqrt(share, out=share)
        np.maximum(share, np.float32(1e-9), out=share)
        bones, pairs = share[:, :n_bones], share[:, n_bones:]
        wanted = np.multiply(self.lengths[block], state.scales, out=work.share[:, :n_bones])
        np.divide(wanted, bones, out=bones)
        np.maximum(np.divide(self.least[block], pairs, out=pairs), np.float32(1), out=pairs)
        # The pulled point mirrored at its own place: 2 s p - p.
        np.multiply(share, np.float32(2), out=work.share)
        np.subtract(work.share, np.float32(1), out=work.share)
        np.multiply(point, work.share[:, :, None], out=held)
        # Less the source before it is summed: forces that cancel must do so to the last digit, as
        # hardly anything but the anchor holds the scene as a whole.
        np.subtract(held, self.source[block], out=held)
        right = state.right[block]
        np.matmul(self.spread[block], work.halves(held), out=work.halves(right))
        np.add(right, state.pull[block], out=right)

    def _tie(self, rows: Single, frame: int, out: Single) -> None:
        """Multiply by C_k: from the frames of a block to those of the next."""
        near, far = self.factor.next_frame, self.factor.next_but_one
        half = len(rows) // 2
        upper, lower = rows[:half], rows[half:]
        np.multiply(lower, near[frame + 1], out=out[:half])
        np.multiply(upper, far[frame], out=out[half:])
        np.add(out[:half], out[half:], out=out[:half])
        np.multiply(lower, far[frame + 1], out=out[half:])

    def _tie_back(self, rows: Single, frame: int, out: Single) -> None:
        """Multiply by the transpose of C_k: from the next block's frames to a block's."""
        near, far = self.factor.next_frame, self.factor.next_but_one
        half = len(rows) // 2
        upper, lower = rows[:half], rows[half:]
        np.multiply(upper, near[frame + 1], out=out[half:])
        np.multiply(lower, far[frame + 1], out=out[:half])
        np.add(out[half:], out[:half], out=out[half:])
        np.multiply(upper, far[frame], out=out[:half])


def solver_of(factor: Factor, rows: Rows, *, n_bones: int, relaxation: float) -> Solver:
    """Lay out rows for the solver, in blocks, directions in the order of ``AXES``.

    Parameters
    ----------
    factor : of the energy with the rows' penalties
    rows : what is held
    n_bones : how many of the rows are bones; the others are pairs to keep apart
    relaxation : 1 to 2
    """
    n_points = factor.next_frame.shape[1]
    pairs, source = in_pairs(rows.pairs), in_pairs(rows.source[..., AXES])
    matrix = differences(rows.pairs, n_points)
    spread = in_pairs((rows.weights[..., None] * matrix).transpose(0, 2, 1).astype(np.float32))
    lower = pairs + np.array([0, n_points])[:, None, None]
    first, second = (lower[..., end].reshape(len(pairs), -1) for end in (0, 1))
    # A frame that only fills up the last block has no bones; any direction serves it.
    lengths = np.linalg.norm(source[:, :, :n_bones], axis=-1)
    return Solver(
        factor=factor,
        ends=(np.ascontiguousarray(first), np.ascontiguousarray(second)),
        spread=np.ascontiguousarray(spread),
        source=source[..., None].astype(np.float32),
        lengths=lengths[..., None].astype(np.float32),
        least=in_pairs(rows.least)[..., None].astype(np.float32),
        guarded=rows.pairs[:, n_bones:],
        relaxation=relaxation,
    )
