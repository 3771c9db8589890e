"""ADMM: minimises the energy under bone length and separation constraints, many bodies at once.

Boyd et al. (2011), *Distributed optimization and statistical learning via the alternating direction
method of multipliers*, section 3.1.1 (scaled form):

    x: minimise E(U) + 1/2 |A U + a - z + u|_P^2         linear step, one factorisation   eq. 3.5
    z: project A U + a + u on the constraints            local step, each row alone       eq. 3.6
    u: u + A U + a - z                                   scaled dual                      eq. 3.7

with U the displacement, A the differences of constrained points, a these differences in the source,
P the diagonal matrix of penalties. A row of z is a difference whose length is within its bounds:
for a bone, the target length. Bounds between the bodies are elastic: z is the proximal point of
``1/2 stiffness distance(z, bounds)^2``, a fraction of the way from v to its projection (Parikh and
Boyd (2014), *Proximal algorithms*, section 6.1). Further rows are heights of joints above the
floor. In the form of Douglas and Rachford one state serves for z and u, the governing variable
``v = z + u``: z is the proximal point of v, ``z = s v`` with a scalar s per row, u is the rest, and
an iteration is ``v + A U + a - z``. Of the bones of a pelvis or chest z is the rotated part that is
nearest to v (``rigid_parts``): there s is 0, and z is kept beside it. Over-relaxation (section
3.4.3) saves nothing beside the acceleration of the iterates.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from pacmo_core.interaction_mesh.acceleration import Iterates
from pacmo_core.interaction_mesh.constraints import Floor, Rows
from pacmo_core.interaction_mesh.factorisation import Factorisation
from pacmo_core.interaction_mesh.linear_algebra import (
    column_groups,
    padded_columns,
    padded_width,
    pair_frames,
    to_blocks,
)
from pacmo_core.interaction_mesh.rigid_parts import RigidParts
from pacmo_core.interaction_mesh.scene import Array, Single

# Blocks that take the local step together. Their data fit into the processor's cache; fewer would
# cost more calls.
BLOCKS_PER_STEP = 4
# Metres, the largest steps of a row between the bodies and of a height when ADMM has converged: one
# contact of a clip, or one toe in the floor, hardly counts in the residual.
PAIR_TOLERANCE = 5e-4
FLOOR_TOLERANCE = 2e-3
# Of the directions x, y, z. The horizontal ones share a factorisation.
HORIZONTAL, VERTICAL = slice(0, 3, 2), 1
# Iterations between two checks of convergence.
CHECK_EVERY = 3


@dataclass(frozen=True)
class State:
    """The state of ADMM for V bodies side by side, in K blocks of two frames.

    The three directions come before the rows: a factor of each row then multiplies one long run of
    memory, also where few bodies are left.

    Parameters
    ----------
    energy_rhs : (K, 3, 2N, V) float32, the energy's own right-hand side g
    rhs : (K, 3, 2N, V) float32, right-hand side of the linear step
    displacement : (K, 3, 2N, V) float32 metres, U
    governing : (K, 3, 2, R, V) float32 metres, v
    projection : (K, 2, R, V) float32, s; ``s v`` is the proximal point of v, where s is not 0
    rigid : (K, 3, 2, Q, V) float32 metres, the proximal points of the bones of rigid parts
    turns : (K, 4, 2, G, V) float32, quaternions of rigid parts
    floor : (K, 2, F, V) float32 metres, v of the heights above the ground
    scales : (R, V) float32, factor on the bounds of each row
    lowest : (F, V) float32 metres, lower bound of the heights above the ground
    squared_step : (V,) squared step of v in a measured iteration, summed over rows
    largest_step : (V,) squared ratio of the largest step of a row between the bodies, or of a
        height, to its tolerance
    """

    energy_rhs: Single
    rhs: Single
    displacement: Single
    governing: Single
    projection: Single
    rigid: Single
    turns: Single
    floor: Single
    scales: Single
    lowest: Single
    squared_step: NDArray[np.float64]
    largest_step: Single

    @property
    def n_bodies(self) -> int:
        """Number of bodies side by side."""
        return len(self.squared_step)

    def bones(self, rows: NDArray[np.intp], n_bones: int) -> Single:
        """``(K, 3, 2, E, V)`` metres: the proximal points of all bones; ``rows`` (Q,) are rigid."""
        bones = self.governing[:, :, :, :n_bones] * self.projection[:, None, :, :n_bones]
        bones[:, :, :, rows] = self.rigid
        return bones

    def select(self, bodies: NDArray[np.intp]) -> "State":
        """Return the state of some of the bodies."""
        return State(**{name: values.take(bodies, axis=-1) for name, values in vars(self).items()})

    def clear_steps(self) -> "State":
        """Set the measured steps to zero; return the state itself."""
        self.squared_step[:] = 0
        self.largest_step[:] = 0
        return self

    @property
    def iterate(self) -> tuple[Single, Single]:
        """The fixed-point iteration's variable: v of the rows and of the heights."""
        return self.governing, self.floor

    def workspace(self) -> "Workspace":
        """Allocate working arrays."""
        return Workspace(self.governing.shape[3], self.displacement.shape[2], self.n_bodies)


class Workspace:
    """Working arrays, allocated once for many iterations.

    Attributes
    ----------
    is_measured : whether an iteration adds to ``State.squared_step``
    """

    def __init__(self, n_rows: int, n_points: int, n_bodies: int) -> None:
        self.is_measured = False
        self.coupled = np.zeros((3, n_points, n_bodies), dtype=np.float32)
        self.correction = np.zeros_like(self.coupled)
        self._rows = np.zeros((BLOCKS_PER_STEP, 3, 2, n_rows, n_bodies), dtype=np.float32)
        self._other_rows = np.zeros_like(self._rows)
        self._factors = np.zeros(self._rows[:, 0].shape, dtype=np.float32)

    def arrays(self, n_blocks: int) -> tuple[Single, Single, Single]:
        """Return two arrays of differences, (B, 3, 2, R, V), and one of factors, (B, 2, R, V)."""
        return self._rows[:n_blocks], self._other_rows[:n_blocks], self._factors[:n_blocks]


@dataclass(frozen=True)
class AdmmSolver:
    """The iteration for one source and its penalties, in K blocks of two frames.

    Parameters
    ----------
    factorisation : of ``H + A^T P A``
    rows : the differences
    gather, scatter : A, and A^T P, of each ``BLOCKS_PER_STEP`` blocks
    source : (K, 3, 2, R, 1) float32 metres, a
    penalties : (K, 2, R, 1) float32
    lower, upper : (K, 2, R, 1) float32 metres, bounds on the lengths
    elasticity : (K, 2, R, 1) float32, fraction of the way from v to its projection
    parts : pelvises and chests
    floor : the heights
    floor_source, floor_penalties : (K, 2, F, 1) float32
    """

    factorisation: Factorisation
    rows: Rows
    gather: tuple[csr_array, ...]
    scatter: tuple[csr_array, ...]
    source: Single
    penalties: Single
    lower: Single
    upper: Single
    elasticity: Single
    parts: RigidParts
    floor: Floor
    floor_source: Single
    floor_penalties: Single

    def iterate(self, state: State, work: Workspace) -> None:
        """Take one ADMM iteration: a linear and a local step.

        The governing variable of a block is updated while it is in the processor's cache.
        """
        self._forward(state, work)
        last = len(self.source)
        for block in self._backward(state, work):
            if block % BLOCKS_PER_STEP == 0:
                self._update(state, work, slice(block, last))
                last = block
        self.project(state, work)

    @property
    def iterate_penalties(self) -> tuple[Single, Single]:
        """P of ``State.iterate``, (K, 1, 2, R, 1) and (K, 2, F, 1)."""
        return self.penalties[:, None], self.floor_penalties

    def project(self, state: State, work: Workspace) -> None:
        """Project a new governing variable and set the right-hand side of the linear step."""
        state.rigid[:] = self.parts.nearest(state.governing, state.scales, state.turns)
        for block in range(0, len(self.source), BLOCKS_PER_STEP):
            self._project(state, work, slice(block, min(block + BLOCKS_PER_STEP, len(self.source))))

    def _forward(self, state: State, work: Workspace) -> None:
        """Eliminate: ``w_k = S_k^-1 (b_k - C_k-1 w_k-1)``."""
        rhs, solution = column_groups(state.rhs), column_groups(state.displacement)
        for block in range(len(self.source)):
            if block:
                self._couple_next(state.displacement[block - 1], 2 * block - 2, work.coupled)
                np.subtract(state.rhs[block], work.coupled, out=state.rhs[block])
            self._apply_pivot(block, rhs[block], solution[block])

    def _backward(self, state: State, work: Workspace) -> Iterator[int]:
        """Substitute: ``U_k = w_k - S_k^-1 C_k^T U_k+1``; yield each block after that."""
        coupled, correction = column_groups(work.coupled), column_groups(work.correction)
        last = len(self.source) - 1
        for block in range(last, -1, -1):
            if block < last:
                self._couple_previous(state.displacement[block + 1], 2 * block, work.coupled)
                self._apply_pivot(block, coupled, correction)
                displacement = state.displacement[block]
                np.subtract(displacement, work.correction, out=displacement)
            yield block

    def _apply_pivot(self, block: int, rhs: Single, out: Single) -> None:
        """Multiply by S_k^-1."""
        np.matmul(self.factorisation.horizontal[block], rhs[HORIZONTAL], out=out[HORIZONTAL])
        np.matmul(self.factorisation.vertical[block], rhs[VERTICAL], out=out[VERTICAL])

    def _update(self, state: State, work: Workspace, blocks: slice) -> None:
        """Update the governing variable, ``v + A U + a - s v``."""
        rows, other, factors = work.arrays(blocks.stop - blocks.start)
        governing = state.governing[blocks]
        displacement = state.displacement[blocks].reshape(-1, state.n_bodies)
        differences = self.gather[blocks.start // BLOCKS_PER_STEP] @ displacement
        np.add(differences.reshape(rows.shape), self.source[blocks], out=rows)
        np.subtract(np.float32(1), state.projection[blocks], out=factors)
        if work.is_measured:
            other[:] = governing
        np.multiply(governing, factors[:, None], out=governing)
        governing[:, :, :, self.parts.rows] -= state.rigid[blocks]
        np.add(governing, rows, out=governing)
        if work.is_measured:
            np.subtract(other, governing, out=other)
            np.multiply(other, other, out=other)
            _add_rows(other, state.squared_step)
            pairs = other[..., self.rows.n_body_rows :, :].sum(axis=1)
            _add_largest(pairs, PAIR_TOLERANCE, state.largest_step)
        self._floor_step(state, work, blocks)

    def _floor_step(self, state: State, work: Workspace, blocks: slice) -> None:
        """Update the governing variable of the heights."""
        floor = state.floor[blocks]
        step = self._heights(state.displacement[blocks])
        step += self.floor_source[blocks]
        step -= np.maximum(floor, state.lowest)
        floor += step
        if work.is_measured:
            squares = step * step
            _add_rows(squares, state.squared_step)
            _add_largest(squares, FLOOR_TOLERANCE, state.largest_step)

    def _heights(self, displacement: Single) -> Single:
        """Return those of the floor's joints, (B, 2, F, V), of a displacement (B, 3, 2N, V)."""
        return _frames(displacement[:, VERTICAL])[:, :, self.floor.joints]

    def _project(self, state: State, work: Workspace, blocks: slice) -> None:
        """Compute the factor s of the proximal point, and the right-hand side of the linear step.

        The projection of a row on its bounds has its direction, and the nearest allowed length.
        """
        rows, _, factors = work.arrays(blocks.stop - blocks.start)
        governing, projection = state.governing[blocks], state.projection[blocks]
        np.multiply(governing, governing, out=rows)
        np.add(rows[:, 0], rows[:, 1], out=projection)
        np.add(projection, rows[:, 2], out=projection)
        np.sqrt(projection, out=projection)
        np.maximum(projection, np.float32(1e-9), out=projection)
        lengths = np.multiply(self.lower[blocks], state.scales, out=factors)
        np.maximum(lengths, projection, out=lengths)
        np.minimum(lengths, self.upper[blocks] * state.scales, out=lengths)
        np.divide(lengths, projection, out=projection)
        np.subtract(projection, np.float32(1), out=projection)
        np.multiply(projection, self.elasticity[blocks], out=projection)
        np.add(projection, np.float32(1), out=projection)
        projection[:, :, self.parts.rows] = 0
        # The reflection of v at its proximal point, 2 s v - v = z - u.
        np.multiply(projection, np.float32(2), out=factors)
        np.subtract(factors, np.float32(1), out=factors)
        np.multiply(governing, factors[:, None], out=rows)
        rows[:, :, :, self.parts.rows] += 2 * state.rigid[blocks]
        # The source is subtracted before the sum: forces that cancel must do so to the last digit,
        # as hardly anything but the regularisation fixes the position of the scene.
        np.subtract(rows, self.source[blocks], out=rows)
        rhs, energy_rhs = state.rhs[blocks], state.energy_rhs[blocks]
        scatter = self.scatter[blocks.start // BLOCKS_PER_STEP]
        forces = scatter @ rows.reshape(-1, state.n_bodies)
        np.add(forces.reshape(rhs.shape), energy_rhs, out=rhs)
        floor = state.floor[blocks]
        reflected = 2 * np.maximum(floor, state.lowest) - floor - self.floor_source[blocks]
        heights = _frames(rhs[:, VERTICAL])
        heights[:, :, self.floor.joints] += self.floor_penalties[blocks] * reflected

    def _couple_next(self, rows: Single, frame: int, out: Single) -> None:
        """Multiply by C_k: from the frames of a block to those of the next."""
        lag_one, lag_two = self.factorisation.lag_one, self.factorisation.lag_two
        upper, lower, top, bottom = *_halves(rows), *_halves(out)
        np.multiply(lower, lag_one[frame + 1], out=top)
        np.multiply(upper, lag_two[frame], out=bottom)
        np.add(top, bottom, out=top)
        np.multiply(lower, lag_two[frame + 1], out=bottom)

    def _couple_previous(self, rows: Single, frame: int, out: Single) -> None:
        """Multiply by C_k^T: from the next block's frames to those of a block."""
        lag_one, lag_two = self.factorisation.lag_one, self.factorisation.lag_two
        upper, lower, top, bottom = *_halves(rows), *_halves(out)
        np.multiply(upper, lag_one[frame + 1], out=bottom)
        np.multiply(lower, lag_two[frame + 1], out=top)
        np.add(bottom, top, out=bottom)
        np.multiply(upper, lag_two[frame], out=top)


def _frames(blocks: Single) -> Single:
    """View blocks (B, 2N, V) as frames, (B, 2, N, V)."""
    return blocks.reshape(len(blocks), 2, -1, blocks.shape[-1])


def _halves(block: Single) -> tuple[Single, Single]:
    """View a block (3, 2N, V) as its two frames."""
    half = block.shape[1] // 2
    return block[:, :half], block[:, half:]


def _add_rows(values: Single, total: NDArray[np.float64]) -> None:
    """Add values (B, ..., V) to a total (V,), row by row: in one order for any number of bodies."""
    for block in values.reshape(len(values), -1, values.shape[-1])[::-1]:
        total += np.add.reduce(block, axis=0)


def _add_largest(squares: Single, tolerance: float, largest: Single) -> None:
    """Raise the largest squared ratios (V,) to those of squared steps (..., V)."""
    ratios = squares.reshape(-1, squares.shape[-1]).max(axis=0, initial=0)
    np.maximum(largest, ratios / np.float32(tolerance**2), out=largest)


def build_solver(
    factorisation: Factorisation, rows: Rows, parts: RigidParts, floor: Floor, source: Array
) -> AdmmSolver:
    """Arrange constraints in blocks.

    Parameters
    ----------
    factorisation : of the energy with the penalties of rows and floor
    parts : among the bones, the first of the rows
    source : (T, R, 3) metres, the differences in the source
    """
    n_points = factorisation.lag_one.shape[1]
    points, coefficients = pair_frames(rows.points), pair_frames(rows.coefficients)
    penalties = pair_frames(rows.penalties)
    lower, upper, elasticity, floor_penalties = (
        pair_frames(values)[..., None].astype(np.float32)
        for values in (rows.lower, rows.upper, rows.elasticity, floor.penalties)
    )
    # A frame that only pads the last block is above the floor as well.
    floor_source = pair_frames(floor.heights, repeat=True)[..., None].astype(np.float32)
    matrices = []
    for first in range(0, len(points), BLOCKS_PER_STEP):
        blocks = slice(first, first + BLOCKS_PER_STEP)
        gather = _difference_matrix(points[blocks], coefficients[blocks], n_points)
        weights = np.repeat(penalties[blocks, None], 3, axis=1)
        weighted = csr_array(gather.T.multiply(weights.reshape(-1)))
        matrices.append((gather.astype(np.float32), weighted.astype(np.float32)))
    return AdmmSolver(
        factorisation=factorisation,
        rows=rows,
        gather=tuple(gather for gather, _ in matrices),
        scatter=tuple(scatter for _, scatter in matrices),
        source=to_blocks(source[..., None]),
        penalties=penalties[..., None].astype(np.float32),
        lower=lower,
        upper=upper,
        elasticity=elasticity,
        parts=parts,
        floor=floor,
        floor_source=floor_source,
        floor_penalties=floor_penalties,
    )


def _difference_matrix(points: NDArray[np.intp], coefficients: Array, n_points: int) -> csr_array:
    """Return A of some blocks, the same in each direction; points, coefficients (B, 2, R, 4)."""
    n_blocks, _, n_rows, _ = points.shape
    frames = np.arange(6 * n_blocks).reshape(n_blocks, 3, 2, 1, 1)
    columns = points[:, None] + n_points * frames
    rows = np.arange(n_rows)[:, None] + n_rows * frames + np.zeros_like(columns)
    values = np.broadcast_to(coefficients[:, None], columns.shape)
    is_used = values != 0
    shape = (6 * n_blocks * n_rows, 6 * n_blocks * n_points)
    return csr_array((values[is_used], (rows[is_used], columns[is_used])), shape=shape)


@dataclass(frozen=True)
class AdmmStart:
    """The start of ADMM for V bodies.

    Parameters
    ----------
    energy_rhs : (K, 3, 2N, V) float32, g
    governing : (K, 3, 2, R, V) float32 metres, v
    floor : (K, 2, F, V) float32 metres, v of the heights
    scales : (R, V) float32, factors on the bounds
    lowest : (F, V) float32 metres, lower bounds of the heights
    step_scale : (V,) square metres, what the squared step is relative to
    n_bones : E, the first of the rows
    """

    energy_rhs: Single
    governing: Single
    floor: Single
    scales: Single
    lowest: Single
    step_scale: Array
    n_bones: int


@dataclass(frozen=True)
class AdmmSolution:
    """The result of ADMM for V bodies.

    Parameters
    ----------
    displacement : (K, 3, 2N, V) float32 metres, U
    governing : (K, 3, 2, R, V) float32 metres, v
    bones : (K, 3, 2, E, V) float32 metres, z of the bones
    residual : (V,) fixed-point residual: the last step of v relative to ``step_scale``, root mean
        square; or the tolerance times the largest step of a row relative to its own, if that is
        more
    iterations : (V,)
    """

    displacement: Single
    governing: Single
    bones: Single
    residual: Array
    iterations: NDArray[np.intp]

    def store(
        self, solver: AdmmSolver, state: State, rows: NDArray[np.intp], columns: NDArray[np.intp]
    ) -> None:
        """Copy the state of the bodies ``columns`` to the ``rows`` of the result."""
        if len(rows):
            state, n_bones = state.select(columns), self.bones.shape[3]
            self.displacement[..., rows] = state.displacement
            self.governing[..., rows] = state.governing
            self.bones[..., rows] = state.bones(solver.parts.rows, n_bones)


def solve_admm(
    solver: AdmmSolver, start: AdmmStart, *, max_iterations: int, tolerance: float
) -> AdmmSolution:
    """Iterate each body until its fixed-point residual is at most ``tolerance``.

    The result of a body does not depend on the other bodies.
    """
    n_bodies = len(start.step_scale)
    columns = padded_columns(n_bodies)
    active = np.arange(len(columns)) < n_bodies  # the others only pad
    state = _initial_state(solver, start)
    solution, work = _empty_solution(start), state.workspace()
    solver.project(state, work)
    iterates = Iterates(state.iterate, solver.iterate_penalties)
    for number in range(1, max_iterations + 1):
        is_last = number == max_iterations
        work.is_measured = number % CHECK_EVERY == 0 or is_last
        solver.iterate(state.clear_steps(), work)
        iterates.add(state.iterate)
        if work.is_measured:
            residuals = _measure(state, start.step_scale[columns], tolerance)
            converged = ((residuals <= tolerance) | is_last) & active
            rows = columns[converged]
            solution.residual[rows], solution.iterations[rows] = residuals[converged], number
            solution.store(solver, state, rows, np.flatnonzero(converged))
            active &= ~converged
            width = padded_width(int(active.sum()))
            if not width:
                break
            if width < state.n_bodies:
                remaining = np.resize(np.flatnonzero(active), width)
                state, columns = state.select(remaining), columns[remaining]
                iterates.select(remaining)
                active, work = np.arange(width) < active.sum(), state.workspace()
        if iterates.is_full:
            iterates.move(state.iterate)
            solver.project(state, work)
    return solution


def _measure(state: State, step_scale: Array, tolerance: float) -> Array:
    """Return the fixed-point residual of each body, (V,); converged are those within tolerance."""
    of_all = np.sqrt(state.squared_step / step_scale)
    residuals: Array = np.maximum(of_all, tolerance * np.sqrt(state.largest_step))
    return residuals


def _initial_state(solver: AdmmSolver, start: AdmmStart) -> State:
    bodies = padded_columns(len(start.step_scale))
    governing = start.governing.take(bodies, axis=-1)
    energy_rhs = start.energy_rhs.take(bodies, axis=-1)
    return State(
        energy_rhs=energy_rhs,
        rhs=np.zeros_like(energy_rhs),
        displacement=np.zeros_like(energy_rhs),
        governing=governing,
        projection=np.zeros_like(governing[:, 0]),
        rigid=np.zeros_like(governing[:, :, :, solver.parts.rows]),
        turns=solver.parts.unturned(len(bodies)),
        floor=start.floor.take(bodies, axis=-1),
        scales=start.scales.take(bodies, axis=-1),
        lowest=start.lowest.take(bodies, axis=-1),
        squared_step=np.zeros(len(bodies)),
        largest_step=np.zeros(len(bodies), dtype=np.float32),
    )


def _empty_solution(start: AdmmStart) -> AdmmSolution:
    n_bodies = len(start.step_scale)
    return AdmmSolution(
        displacement=np.zeros_like(start.energy_rhs),
        governing=np.zeros_like(start.governing),
        bones=np.zeros_like(start.governing[:, :, :, : start.n_bones]),
        residual=np.zeros(n_bodies),
        iterations=np.zeros(n_bodies, dtype=np.intp),
    )
