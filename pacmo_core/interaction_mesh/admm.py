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
from scipy.sparse import csr_array

from pacmo_core.interaction_mesh.factor import Factor
from pacmo_core.interaction_mesh.products import in_parts
from pacmo_core.interaction_mesh.scene import Single
from pacmo_core.interaction_mesh.state import TOGETHER, State, Work


@dataclass(frozen=True)
class Solver:
    """One source and its penalties, which serve any number of bodies; K blocks of two frames.

    Parameters
    ----------
    factor : of the energy with the rows' penalties
    ends : two of (2KR,), which of all 2KN points each difference goes from, and to
    spread : of each ``TOGETHER`` blocks, from their differences back to their points, times
        penalties
    source : (K, 2, R, 3, 1) float32 metres, the differences in the source
    lengths : (K, 2, E, 1) float32 metres, of bones in the source
    least : (K, 2, R - E, 1) float32 metres
    guarded : (T, R - E, 2), the pairs of points
    relaxation : 1 to 2
    """

    factor: Factor
    ends: tuple[NDArray[np.intp], NDArray[np.intp]]
    spread: tuple[csr_array, ...]
    source: Single
    lengths: Single
    least: Single
    guarded: NDArray[np.intp]
    relaxation: float

    def iterate(self, state: State, work: Work) -> None:
        """Take a linear and a local step.

        The local one follows close behind, while the blocks are in the processor's cache.
        """
        self._forward(state, work)
        last = len(self.source)
        for block in self._backward(state, work):
            if block % TOGETHER == 0:
                self._local_step(state, work, slice(block, last))
                last = block

    def settle(self, state: State) -> None:
        """Follow up a new ``point``: what it leaves to the linear step."""
        work = state.work(self.source.shape[2])
        for block in range(0, len(self.source), TOGETHER):
            self._pull(state, work, slice(block, min(block + TOGETHER, len(self.source))))

    def _forward(self, state: State, work: Work) -> None:
        """Eliminate: ``w_k = S_k^-1 (b_k - C_k-1 w_k-1)``."""
        right, solved = in_parts(state.right), in_parts(state.change)
        for block in range(len(self.source)):
            if block:
                self._tie(state.change[block - 1], 2 * block - 2, work.tied)
                np.subtract(state.right[block], work.tied, out=state.right[block])
            self._solve(block, right[block], solved[block])

    def _backward(self, state: State, work: Work) -> Iterator[int]:
        """Substitute: ``U_k = w_k - S_k^-1 C_k^T U_k+1``."""
        tied, moved = in_parts(work.tied), in_parts(work.moved)
        last = len(self.source) - 1
        for block in range(last, -1, -1):
            if block < last:
                self._tie_back(state.change[block + 1], 2 * block, work.tied)
                self._solve(block, tied, moved)
                np.subtract(state.change[block], work.moved, out=state.change[block])
            yield block

    def _solve(self, block: int, right: Single, out: Single) -> None:
        """Multiply by S_k^-1; two thirds of the columns are of horizontal directions."""
        split = 2 * len(right) // 3
        np.matmul(self.factor.across[block], right[:split], out=out[:split])
        np.matmul(self.factor.upright[block], right[split:], out=out[split:])

    def _local_step(self, state: State, work: Work, blocks: slice) -> None:
        """Move the points by what the linear step and the lengths disagree, over-relaxed."""
        held, other, share = work.of(blocks.stop - blocks.start)
        point = state.point[blocks]
        self._differences(state, blocks, held, other)
        np.add(held, self.source[blocks], out=held)
        np.multiply(state.share[blocks], np.float32(-self.relaxation), out=share)
        np.add(share, np.float32(1), out=share)
        np.multiply(held, np.float32(self.relaxation), out=held)
        if work.watched:
            other[:] = point
        np.multiply(point, share[:, :, :, None], out=point)
        np.add(point, held, out=point)
        if work.watched:
            np.subtract(other, point, out=other)
            if work.longer is not None:
                np.subtract(point, np.multiply(other, work.longer, out=held), out=point)
            np.multiply(other, other, out=other)
            # Row by row, in the same order whatever the number of columns.
            for each in other.reshape(len(other), -1, state.n_bodies)[::-1]:
                state.moved[:] += np.add.reduce(each, axis=0)
        self._pull(state, work, blocks)

    def _differences(self, state: State, blocks: slice, out: Single, room: Single) -> None:
        """Give the change of every difference."""
        n_rows = 2 * self.source.shape[2]
        rows = slice(n_rows * blocks.start, n_rows * blocks.stop)
        change = state.change.reshape(-1, state.change.shape[-1])
        for ends, values in zip(self.ends, (room, out), strict=True):
            into = values.reshape(-1, change.shape[-1])
            np.take(change, ends[rows], axis=0, out=into, mode="clip")
        np.subtract(out, room, out=out)

    def _pull(self, state: State, work: Work, blocks: slice) -> None:
        """Pull every difference to where it is allowed, and say what the rest must meet."""
        held, _, room = work.of(blocks.stop - blocks.start)
        point, share = state.point[blocks], state.share[blocks]
        n_bones = self.lengths.shape[2]
        np.multiply(point, point, out=held)
        np.add(held[:, :, :, 0], held[:, :, :, 1], out=share)
        np.add(share, held[:, :, :, 2], out=share)
        np.sqrt(share, out=share)
        np.maximum(share, np.float32(1e-9), out=share)
        bones, pairs = share[:, :, :n_bones], share[:, :, n_bones:]
        wanted = np.multiply(self.lengths[blocks], state.scales, out=room[:, :, :n_bones])
        np.divide(wanted, bones, out=bones)
        np.maximum(np.divide(self.least[blocks], pairs, out=pairs), np.float32(1), out=pairs)
        # The pulled point mirrored at its own place: 2 s p - p.
        np.multiply(share, np.float32(2), out=room)
        np.subtract(room, np.float32(1), out=room)
        np.multiply(point, room[:, :, :, None], out=held)
        # Less the source before it is summed: forces that cancel must do so to the last digit, as
        # hardly anything but the anchor holds the scene as a whole.
        np.subtract(held, self.source[blocks], out=held)
        right, pull = state.right[blocks], state.pull[blocks]
        forces = self.spread[blocks.start // TOGETHER] @ held.reshape(-1, right.shape[-1])
        np.add(forces.reshape(right.shape), pull, out=right)

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
