"""Iterate bodies side by side until each has settled."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pacmo_core.interaction_mesh.admm import Solver
from pacmo_core.interaction_mesh.products import filled
from pacmo_core.interaction_mesh.scene import Array, Single
from pacmo_core.interaction_mesh.state import State

TINY = 1e-30  # square metres
# Iterations from one look at who has settled to the next.
EVERY = 3
# Every so many looks the step is a long one, at most so many times its own length; as long as it
# pays: since the last one, steps must have shrunk as they would in so many looks without.
LONG_EVERY = 4
LONGEST = 6.0
PAYS = 3.5


@dataclass(frozen=True)
class Start:
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
class Solution:
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
class Pace:
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
    def of_bodies(cls, n_bodies: int) -> "Pace":
        """Begin."""
        huge = np.full(n_bodies, 1 / TINY)
        return cls(huge, huge, np.full(n_bodies, np.inf))

    def after(self, moved: Array) -> "Pace":
        """Look once more."""
        now = moved.clip(TINY, 1 / TINY)
        return replace(self, moved=now, shrunk=now / self.moved)

    def of(self, bodies: NDArray[np.intp]) -> "Pace":
        """Take some of the bodies."""
        return Pace(self.moved[bodies], self.shrunk[bodies], self.before[bodies])

    def lengthened(self) -> tuple[Single, "Pace"]:
        """Give the steps yet to come, (V,), as a multiple of the next, were they to shrink on so.

        None where they do not shrink, or where the last long step did not pay: it has set off a
        swing, and the next would feed it. Aitken's extrapolation, one rate for all of a body.
        """
        pays = self.moved <= self.before * self.shrunk**PAYS
        rate = np.where((self.shrunk < 1) & pays, self.shrunk, 0) ** (0.5 / EVERY)
        all_steps = 1 / (1 - rate).clip(min=1 / LONGEST)
        before = np.where(pays, self.moved, 0)
        return (all_steps - 1).astype(np.float32), replace(self, before=before)


def solve(solver: Solver, start: Start, *, iterations: int, step: float) -> Solution:
    """Iterate; a body stops once its ``step`` is small enough.

    Whatever the others do: what is found for a body does not depend on its company.
    """
    n_bodies = len(start.asked)
    state, columns = _begun(solver, start), np.resize(np.arange(n_bodies), filled(n_bodies))
    found, work = _room(start, state), state.work(start.point.shape[2])
    going = np.arange(len(columns)) < n_bodies  # the others only fill up
    pace = Pace.of_bodies(len(columns))
    # Steps of bodies that push each other apart swing, and long ones would have them swing on.
    is_free = not solver.guarded.shape[1]
    for number in range(1, iterations + 1):
        is_long = number % (LONG_EVERY * EVERY) == 0 and number < iterations and is_free
        work.longer, pace = pace.lengthened() if is_long else (None, pace)
        work.watched = number % EVERY == 0 or number == iterations
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
    bodies = np.resize(np.arange(len(start.asked)), filled(len(start.asked)))
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
    n_bodies = len(start.asked)
    return Solution(
        change=np.zeros_like(start.pull),
        point=np.zeros_like(start.point),
        share=np.zeros((*state.share.shape[:3], n_bodies), dtype=np.float32),
        step=np.zeros(n_bodies),
        iterations=np.zeros(n_bodies, dtype=np.intp),
    )
