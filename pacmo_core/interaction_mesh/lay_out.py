"""Lay out a source and its penalties as the solver takes them."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from pacmo_core.interaction_mesh.admm import Solver
from pacmo_core.interaction_mesh.blocks import AXES, in_pairs
from pacmo_core.interaction_mesh.factor import Factor
from pacmo_core.interaction_mesh.rows import Rows
from pacmo_core.interaction_mesh.scene import Single
from pacmo_core.interaction_mesh.state import TOGETHER


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
    frames = np.arange(2 * len(pairs)).reshape(-1, 2)
    ends = pairs + n_points * frames[:, :, None, None]
    weights = in_pairs(rows.weights).astype(np.float32)
    # A frame that only fills up the last block has no bones; any direction serves it.
    lengths = np.linalg.norm(source[:, :, :n_bones], axis=-1)
    return Solver(
        factor=factor,
        ends=(ends[..., 0].reshape(-1), ends[..., 1].reshape(-1)),
        spread=tuple(
            _spread(ends[first : first + TOGETHER], weights[first : first + TOGETHER], n_points)
            for first in range(0, len(ends), TOGETHER)
        ),
        source=source[..., None].astype(np.float32),
        lengths=lengths[..., None].astype(np.float32),
        least=in_pairs(rows.least)[..., None].astype(np.float32),
        guarded=rows.pairs[:, n_bones:],
        relaxation=relaxation,
    )


def _spread(ends: NDArray[np.intp], weights: Single, n_points: int) -> csr_array:
    """Take forces of differences to their ends: some blocks, (B, 2, R, 2) and (B, 2, R)."""
    n_rows = weights.size
    points = ends.reshape(-1, 2).T - ends.reshape(-1).min() // (2 * n_points) * 2 * n_points
    values = np.concatenate([-weights.reshape(-1), weights.reshape(-1)])
    where = (points.reshape(-1), np.tile(np.arange(n_rows), 2))
    return csr_array((values, where), shape=(2 * n_points * len(ends), n_rows))
