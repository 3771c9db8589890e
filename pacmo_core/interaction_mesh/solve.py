"""Iterate bodies side by side until each has settled."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pacmo_core.interaction_mesh.admm import Solver
from pacmo_core.interaction_mesh.scene import Array, Single
from pacmo_core.interaction_mesh.state import State

# Bodies side by side are filled up to a multiple of this. Products of matrices of odd widths round
# otherwise, and a variation must not depend on its company.
WIDTH = 16
TINY = 1e-30  # square metres
# Iterations from one look at who has settled to the next.
EVERY = 4
# Every so many looks the step is a long one, at most so many times its own length.
LONG_EVERY = 3
LONGEST = 4.0


@dataclass(frozen=True)
class Start:
    """Where bodies start from.

    Parameters
    ----------
    pull : (K, 2N, 3, V) float32, the energy's own right-hand side
    point : (K, 2, R, 3, V) float32 metres
    scales : (E, V) float32
    grown : (V,) square metres by which bones grow, summed over frames and bones
    """

    pull: Single
    point: Single
    scales: Single
    grown: Array


@dataclass(frozen=True)
class Solution:
    """What the solver gives; directions in the order of ``AXES``.

    Parameters
    ----------
    change : (K, 2N, 3, V) float32 metres, U
    point : (K, 2, R, 3, V) float32 metres, from which to go on
    share : (K, 2, R, V) float32; ``share point`` is what the local step allows
    step : (V,) by how much the last iteration still moved bones, a share of how much they grow,
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
class Pace:
    """How steps shrink, from one look to the next.

    Parameters
    ----------
    moved : (V,) what ``State.moved`` was at the last look
    shrunk : (V,) that as a share of the look's before
    """

    moved: Array
    shrunk: Array

    def after(self, moved: Array) -> "Pace":
        """Look once more."""
        now = moved.clip(TINY, 1 / TINY)
        return Pace(now, now / self.moved)

    def of(self, bodies: NDArray[np.intp]) -> "Pace":
        """Take some of the bodies."""
        return Pace(self.moved[bodies], self.shrunk[bodies])

    def beyond(self) -> Single:
        """``(V,)``: the steps yet to come as a multiple of the next, were they to shrink on so.

        None where they do not shrink. Aitken's extrapolation, a rate for all of a body's points.
        """
        rate = np.where(self.shrunk < 1, self.shrunk, 0) ** (0.5 / EVERY)
        all_steps = 1 / (1 - rate).clip(min=1 / LONGEST)
        return (all_steps - 1).astype(np.float32)


def solve(solver: Solver, start: Start, *, iterations: int, step: float) -> Solution:
    """Iterate; a body stops once its ``step`` is small enough.

    Whatever the others do: what is found for a body does not depend on its company.
    """
    n_bodies = len(start.grown)
    state, columns = _begun(solver, start), np.resize(np.arange(n_bodies), filled(n_bodies))
    found, work = _room(start, state), state.work(start.point.shape[2])
    going = np.arange(len(columns)) < n_bodies  # the others only fill up
    pace = Pace(*np.ones((2, len(columns))))
    # Steps of bodies that push each other apart swing, and long ones would have them swing on.
    is_free = not solver.guarded.shape[1]
    for number in range(1, iterations + 1):
        is_long = number % (LONG_EVERY * EVERY) == 0 and number < iterations and is_free
        work.longer = pace.beyond() if is_long else None
        work.watched = number % EVERY == 0 or number == iterations
        state.moved[:] = 0
        solver.iterate(state, work)
        if is_long or not work.watched:
            continue
        pace = pace.after(state.moved)
        steps = np.sqrt(state.moved / start.grown[columns])
        done = (steps <= step) | (number == iterations)
        done &= going
        found.take(state, columns[done], np.flatnonzero(done), number)
        found.step[columns[done]] = steps[done]
        going &= ~done
        width = filled(int(going.sum()))
        if not width:
            break
        if width < state.n_bodies:
            kept = np.resize(np.flatnonzero(going), width)
            state, columns, pace = state.of(kept), columns[kept], pace.of(kept)
            going = np.arange(width) < going.sum()
            work = state.work(start.point.shape[2])
    return found


def _begun(solver: Solver, start: Start) -> State:
    bodies = np.resize(np.arange(len(start.grown)), filled(len(start.grown)))
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


def _room(start: Start, state: State) -> Solution:
    n_bodies = len(start.grown)
    return Solution(
        change=np.zeros_like(start.pull),
        point=np.zeros_like(start.point),
        share=np.zeros((*state.share.shape[:3], n_bodies), dtype=np.float32),
        step=np.zeros(n_bodies),
        iterations=np.zeros(n_bodies, dtype=np.intp),
    )


def filled(n_bodies: int) -> int:
    """Round up to full width."""
    return -(-n_bodies // WIDTH) * WIDTH
