"""What the solver carries from one iteration to the next, and some blocks' working space."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pacmo_core.interaction_mesh.scene import Single

# Blocks that take the local step together: as many as fit into the processor's cache beside what
# they are made of, as each step has its cost.
TOGETHER = 4


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

    def work(self, n_rows: int) -> "Work":
        """Make room for some blocks."""
        return Work(n_rows, self.change.shape[1], self.n_bodies)


class Work:
    """Arrays that are made once.

    ``watched`` asks iterations to say how far they move; ``longer``, (V,) float32, has a watched
    one go so many times that far beyond.
    """

    def __init__(self, n_rows: int, n_points: int, n_bodies: int) -> None:
        self.watched = False
        self.longer: Single | None = None
        self.tied = np.zeros((n_points, 3 * n_bodies), dtype=np.float32)
        self.moved = np.zeros_like(self.tied)
        self._held = np.zeros((TOGETHER, 2, n_rows, 3, n_bodies), dtype=np.float32)
        self._other = np.zeros_like(self._held)
        self._share = np.zeros(self._held[:, :, :, 0].shape, dtype=np.float32)

    def of(self, n_blocks: int) -> tuple[Single, Single, Single]:
        """Give room for differences, twice, (B, 2, R, 3, V), and for shares, (B, 2, R, V)."""
        return self._held[:n_blocks], self._other[:n_blocks], self._share[:n_blocks]
