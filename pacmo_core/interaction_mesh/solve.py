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
# Iterations from one look at who has settled to the next.
EVERY = 4


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


def solve(solver: Solver, start: Start, *, iterations: int, step: float) -> Solution:
    """Iterate; a body stops once its ``step`` is small enough.

    Whatever the others do: what is found for a body does not depend on its company.
    """
    n_bodies = len(start.grown)
    state, columns = _begun(solver, start), np.resize(np.arange(n_bodies), filled(n_bodies))
    found, work = _room(start, state), state.work(start.point.shape[2])
    going = np.arange(len(columns)) < n_bodies  # the others only fill up
    for number in range(1, iterations + 1):
        work.watched = number % EVERY == 0 or number == iterations
        state.moved[:] = 0
        solver.iterate(state, work)
        if not work.watched:
            continue
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
            state, columns = state.of(kept), columns[kept]
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
