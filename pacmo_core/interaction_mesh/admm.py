"""What the solver carries from one iteration to the next, and some blocks' working space."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from pacmo_core.interaction_mesh.factorisation import (
    AXIS_ORDER,
    Constraints,
    Factorisation,
    pair_frames,
)
from pacmo_core.interaction_mesh.linear_algebra import column_groups, padded_width
from pacmo_core.interaction_mesh.scene import Array, Single

# Blocks that take the local step together: as many as fit into the processor's cache beside what
# they are made of, as each step has its cost.
BLOCKS_PER_STEP = 4


@dataclass(frozen=True)
class State:
    """V bodies side by side; K blocks of two frames.

    Parameters
    ----------
    pull : (K, 2N, 3V) float32, the energy's own right-hand side
    right : (K, 2N, 3V) float32, right-hand side of the linear step
    change : (K, 2N, 3V) float32, its answer
    point : (K, 2, R, 3, V) float32, the differences before the local step, multiplier included
    share : (K, 2, R, V) float32, by which the local step scales them to what is allowed
    scales : (E, V) float32
    moved : (V,) sum of squares by which a watched iteration moved the points
    """

    pull: Single
    right: Single
    change: Single
    point: Single
    share: Single
    scales: Single
    moved: NDArray[np.float64]

    @property
    def n_bodies(self) -> int:
        """How many bodies stand side by side."""
        return len(self.moved)

    def of(self, bodies: NDArray[np.intp]) -> "State":
        """Take some of the bodies."""
        pull, right, change = (
            np.ascontiguousarray(values.reshape(*values.shape[:2], 3, -1)[..., bodies]).reshape(
                *values.shape[:2], -1
            )
            for values in (self.pull, self.right, self.change)
        )
        point, share, scales = (
            np.ascontiguousarray(values[..., bodies])
            for values in (self.point, self.share, self.scales)
        )
        return State(pull, right, change, point, share, scales, self.moved[bodies])

    def work(self, n_rows: int) -> "Workspace":
        """Make room for some blocks."""
        return Workspace(n_rows, self.change.shape[1], self.n_bodies)


class Workspace:
    """Arrays that are made once.

    ``watched`` asks iterations to say how far they move; ``longer``, (V,) float32, has a watched
    one go so many times that far beyond.
    """

    def __init__(self, n_rows: int, n_points: int, n_bodies: int) -> None:
        self.watched = False
        self.longer: Single | None = None
        self.tied = np.zeros((n_points, 3 * n_bodies), dtype=np.float32)
        self.moved = np.zeros_like(self.tied)
        self._held = np.zeros((BLOCKS_PER_STEP, 2, n_rows, 3, n_bodies), dtype=np.float32)
        self._other = np.zeros_like(self._held)
        self._share = np.zeros(self._held[:, :, :, 0].shape, dtype=np.float32)

    def of(self, n_blocks: int) -> tuple[Single, Single, Single]:
        """Give room for differences, twice, (B, 2, R, 3, V), and for shares, (B, 2, R, V)."""
        return self._held[:n_blocks], self._other[:n_blocks], self._share[:n_blocks]


# FROM """The solver: alternating directions, many bodies at once.
# FROM
# FROM Least E(U) with every bone of its length, split into a linear step (all frames and joints at once,
# FROM through one factorisation) and a local one (each bone for itself: pull it to its length). Boyd et
# FROM al. (2011), *Distributed optimization and statistical learning via the alternating direction method
# FROM of multipliers*, section 3; over-relaxed, section 3.4.3. In Douglas and Rachford's form one state,
# FROM the ``point``, stands for the textbook's two: its share ``s`` of the wanted length gives the bone,
# FROM ``s point``, and what is left over the multiplier.
# FROM """
@dataclass(frozen=True)
class AdmmSolver:
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

    factor: Factorisation
    ends: tuple[NDArray[np.intp], NDArray[np.intp]]
    spread: tuple[csr_array, ...]
    source: Single
    lengths: Single
    least: Single
    guarded: NDArray[np.intp]
    relaxation: float

    def iterate(self, state: State, work: Workspace) -> None:
        """Take a linear and a local step.

        The local one follows close behind, while the blocks are in the processor's cache.
        """
        self._forward(state, work)
        last = len(self.source)
        for block in self._backward(state, work):
            if block % BLOCKS_PER_STEP == 0:
                self._local_step(state, work, slice(block, last))
                last = block

    def settle(self, state: State) -> None:
        """Follow up a new ``point``: what it leaves to the linear step."""
        work = state.work(self.source.shape[2])
        for block in range(0, len(self.source), BLOCKS_PER_STEP):
            self._pull(state, work, slice(block, min(block + BLOCKS_PER_STEP, len(self.source))))

    def _forward(self, state: State, work: Workspace) -> None:
        """Eliminate: ``w_k = S_k^-1 (b_k - C_k-1 w_k-1)``."""
        right, solved = column_groups(state.right), column_groups(state.change)
        for block in range(len(self.source)):
            if block:
                self._tie(state.change[block - 1], 2 * block - 2, work.tied)
                np.subtract(state.right[block], work.tied, out=state.right[block])
            self._solve(block, right[block], solved[block])

    def _backward(self, state: State, work: Workspace) -> Iterator[int]:
        """Substitute: ``U_k = w_k - S_k^-1 C_k^T U_k+1``."""
        tied, moved = column_groups(work.tied), column_groups(work.moved)
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

    def _local_step(self, state: State, work: Workspace, blocks: slice) -> None:
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

    def _pull(self, state: State, work: Workspace, blocks: slice) -> None:
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
        forces = self.spread[blocks.start // BLOCKS_PER_STEP] @ held.reshape(-1, right.shape[-1])
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


# FROM """Lay out a source and its penalties as the solver takes them."""
def build_solver(
    factor: Factorisation, rows: Constraints, *, n_bones: int, relaxation: float
) -> AdmmSolver:
    """Lay out rows for the solver, in blocks, directions in the order of ``AXES``.

    Parameters
    ----------
    factor : of the energy with the rows' penalties
    rows : what is held
    n_bones : how many of the rows are bones; the others are pairs to keep apart
    relaxation : 1 to 2
    """
    n_points = factor.next_frame.shape[1]
    pairs, source = pair_frames(rows.pairs), pair_frames(rows.source[..., AXIS_ORDER])
    frames = np.arange(2 * len(pairs)).reshape(-1, 2)
    ends = pairs + n_points * frames[:, :, None, None]
    weights = pair_frames(rows.weights).astype(np.float32)
    # A frame that only fills up the last block has no bones; any direction serves it.
    lengths = np.linalg.norm(source[:, :, :n_bones], axis=-1)
    return AdmmSolver(
        factor=factor,
        ends=(ends[..., 0].reshape(-1), ends[..., 1].reshape(-1)),
        spread=tuple(
            _scatter_matrix(
                ends[first : first + BLOCKS_PER_STEP],
                weights[first : first + BLOCKS_PER_STEP],
                n_points,
            )
            for first in range(0, len(ends), BLOCKS_PER_STEP)
        ),
        source=source[..., None].astype(np.float32),
        lengths=lengths[..., None].astype(np.float32),
        least=pair_frames(rows.least)[..., None].astype(np.float32),
        guarded=rows.pairs[:, n_bones:],
        relaxation=relaxation,
    )


def _scatter_matrix(ends: NDArray[np.intp], weights: Single, n_points: int) -> csr_array:
    """Take forces of differences to their ends: some blocks, (B, 2, R, 2) and (B, 2, R)."""
    n_rows = weights.size
    points = ends.reshape(-1, 2).T - ends.reshape(-1).min() // (2 * n_points) * 2 * n_points
    values = np.concatenate([-weights.reshape(-1), weights.reshape(-1)])
    where = (points.reshape(-1), np.tile(np.arange(n_rows), 2))
    return csr_array((values, where), shape=(2 * n_points * len(ends), n_rows))


# FROM """Iterate bodies side by side until each has settled."""
MIN_SQUARED_STEP = 1e-30  # square metres
# Iterations from one look at who has settled to the next.
CHECK_EVERY = 3
# Every so many looks the step is a long one, at most so many times its own length; as long as it
# pays: since the last one, steps must have shrunk as they would in so many looks without.
EXTRAPOLATE_EVERY = 4
MAX_EXTRAPOLATION = 6.0
REQUIRED_CHECKS = 3.5


@dataclass(frozen=True)
class AdmmStart:
    """Where bodies start from.

    Parameters
    ----------
    pull : (K, 2N, 3, V) float32, the energy's own right-hand side
    point : (K, 2, R, 3, V) float32 metres
    scales : (E, V) float32
    asked : (V,) square metres that steps are held against, all frames and bones together
    """

    pull: Single
    point: Single
    scales: Single
    asked: Array


@dataclass(frozen=True)
class AdmmSolution:
    """What the solver gives; directions in the order of ``AXES``.

    Parameters
    ----------
    change : (K, 2N, 3, V) float32 metres, U
    point : (K, 2, R, 3, V) float32 metres, from which to go on
    share : (K, 2, R, V) float32; ``share point`` is what the local step allows
    step : (V,) by how much the last iteration still moved bones, as a share of what was asked,
        root mean square
    iterations : (V,)
    """

    change: Single
    point: Single
    share: Single
    step: Array
    iterations: NDArray[np.intp]

    def take(
        self, state: State, rows: NDArray[np.intp], columns: NDArray[np.intp], number: int
    ) -> None:
        """Write down bodies that are done."""
        self.change[..., rows] = state.change.reshape(*self.change.shape[:3], -1)[..., columns]
        self.point[..., rows] = state.point[..., columns]
        self.share[..., rows] = state.share[..., columns]
        self.iterations[rows] = number


@dataclass(frozen=True)
class ConvergenceRate:
    """How steps shrink, from one look to the next.

    Parameters
    ----------
    moved : (V,) what ``State.moved`` was at the last look
    shrunk : (V,) that as a share of the look's before
    before : (V,) what it was before the last long step; 0 where that did not pay
    """

    moved: Array
    shrunk: Array
    before: Array

    @classmethod
    def of_bodies(cls, n_bodies: int) -> "ConvergenceRate":
        """Begin."""
        huge = np.full(n_bodies, 1 / MIN_SQUARED_STEP)
        return cls(huge, huge, np.full(n_bodies, np.inf))

    def after(self, moved: Array) -> "ConvergenceRate":
        """Look once more."""
        now = moved.clip(MIN_SQUARED_STEP, 1 / MIN_SQUARED_STEP)
        return replace(self, moved=now, shrunk=now / self.moved)

    def of(self, bodies: NDArray[np.intp]) -> "ConvergenceRate":
        """Take some of the bodies."""
        return ConvergenceRate(self.moved[bodies], self.shrunk[bodies], self.before[bodies])

    def lengthened(self) -> tuple[Single, "ConvergenceRate"]:
        """Give the steps yet to come, (V,), as a multiple of the next, were they to shrink on so.

        None where they do not shrink, or where the last long step did not pay: it has set off a
        swing, and the next would feed it. Aitken's extrapolation, one rate for all of a body.
        """
        pays = self.moved <= self.before * self.shrunk**REQUIRED_CHECKS
        rate = np.where((self.shrunk < 1) & pays, self.shrunk, 0) ** (0.5 / CHECK_EVERY)
        all_steps = 1 / (1 - rate).clip(min=1 / MAX_EXTRAPOLATION)
        before = np.where(pays, self.moved, 0)
        return (all_steps - 1).astype(np.float32), replace(self, before=before)


def solve_admm(
    solver: AdmmSolver, start: AdmmStart, *, iterations: int, step: float
) -> AdmmSolution:
    """Iterate; a body stops once its ``step`` is small enough.

    Whatever the others do: what is found for a body does not depend on its company.
    """
    n_bodies = len(start.asked)
    state, columns = (
        _initial_state(solver, start),
        np.resize(np.arange(n_bodies), padded_width(n_bodies)),
    )
    found, work = _empty_solution(start, state), state.work(start.point.shape[2])
    going = np.arange(len(columns)) < n_bodies  # the others only fill up
    pace = ConvergenceRate.of_bodies(len(columns))
    # Steps of bodies that push each other apart swing, and long ones would have them swing on.
    is_free = not solver.guarded.shape[1]
    for number in range(1, iterations + 1):
        is_long = (
            number % (EXTRAPOLATE_EVERY * CHECK_EVERY) == 0 and number < iterations and is_free
        )
        work.longer, pace = pace.lengthened() if is_long else (None, pace)
        work.watched = number % CHECK_EVERY == 0 or number == iterations
        state.moved[:] = 0
        solver.iterate(state, work)
        if is_long or not work.watched:
            continue
        pace = pace.after(state.moved)
        steps = np.sqrt(state.moved / start.asked[columns])
        done = (steps <= step) | (number == iterations)
        done &= going
        found.take(state, columns[done], np.flatnonzero(done), number)
        found.step[columns[done]] = steps[done]
        going &= ~done
        width = padded_width(int(going.sum()))
        if not width:
            break
        if width < state.n_bodies:
            kept = np.resize(np.flatnonzero(going), width)
            state, columns, pace = state.of(kept), columns[kept], pace.of(kept)
            going = np.arange(width) < going.sum()
            work = state.work(start.point.shape[2])
    return found


def _initial_state(solver: AdmmSolver, start: AdmmStart) -> State:
    bodies = np.resize(np.arange(len(start.asked)), padded_width(len(start.asked)))
    point = np.ascontiguousarray(start.point[..., bodies])
    pull = np.ascontiguousarray(start.pull[..., bodies])
    pull = pull.reshape(*pull.shape[:2], -1)
    state = State(
        pull=pull,
        right=np.zeros_like(pull),
        change=np.zeros_like(pull),
        point=point,
        share=np.zeros((*point.shape[:3], len(bodies)), dtype=np.float32),
        scales=np.ascontiguousarray(start.scales[:, bodies]),
        moved=np.zeros(len(bodies)),
    )
    solver.settle(state)
    return state


def _empty_solution(start: AdmmStart, state: State) -> AdmmSolution:
    n_bodies = len(start.asked)
    return AdmmSolution(
        change=np.zeros_like(start.pull),
        point=np.zeros_like(start.point),
        share=np.zeros((*state.share.shape[:3], n_bodies), dtype=np.float32),
        step=np.zeros(n_bodies),
        iterations=np.zeros(n_bodies, dtype=np.intp),
    )
