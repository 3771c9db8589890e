"""Matrix products whose columns round alike, on one BLAS thread; the solver's block layout.

A BLAS may sum in another order at the edges of a matrix than within it. OpenBLAS does on
processors with AVX2 but without AVX-512 (float32: the first and last eight columns of 32). A
variation must not depend on the others of its batch. Bodies are therefore columns side by side and
are multiplied ``COLUMN_WIDTH`` at a time, all in products of the same shape.
"""

from contextlib import AbstractContextManager
from typing import TypeVar

import numpy as np
import scipy.linalg  # noqa: F401  # loads SciPy's BLAS, which the controller must find
from numpy.typing import NDArray
from threadpoolctl import ThreadpoolController

from pacmo_core.interaction_mesh.scene import Array, Real, Single

Values = TypeVar("Values", Array, Single, NDArray[np.intp])

COLUMN_WIDTH = 8

_CONTROLLER = ThreadpoolController()


def single_blas_thread() -> AbstractContextManager[object]:
    """Limit BLAS to one thread within a ``with`` block.

    Another number of threads rounds differently. The matrices are small, and the callers run as
    many processes as there are cores.
    """
    limits: AbstractContextManager[object] = _CONTROLLER.limit(limits=1, user_api="blas")
    return limits


def padded_width(n_columns: int) -> int:
    """Round a number of columns up to a multiple of ``COLUMN_WIDTH``."""
    return -(-n_columns // COLUMN_WIDTH) * COLUMN_WIDTH


def padded_columns(n_columns: int) -> NDArray[np.intp]:
    """Return columns that fill the padded width: all, then again from the first.

    Sums along few columns round differently, and the result of a body must not depend on how many
    others there are.
    """
    return np.resize(np.arange(n_columns), padded_width(n_columns))


def batched_product(matrix: Real, columns: Real) -> Real:
    """Multiply ``(R, N)`` with ``(N, C)``, ``COLUMN_WIDTH`` columns at a time.

    A column of the result does not depend on the other columns.
    """
    n_columns = columns.shape[1]
    padded: Real = np.zeros((len(columns), padded_width(n_columns)), dtype=columns.dtype)
    padded[:, :n_columns] = columns
    result: Real = np.zeros((len(matrix), padded.shape[1]), dtype=padded.dtype)
    np.matmul(matrix, column_groups(padded), out=column_groups(result))
    return result[:, :n_columns]


def column_groups(columns: Real) -> Real:
    """View ``(..., N, C)`` as ``(..., C / COLUMN_WIDTH, N, COLUMN_WIDTH)``, the same memory."""
    n_groups = columns.shape[-1] // COLUMN_WIDTH
    return np.moveaxis(columns.reshape(*columns.shape[:-1], n_groups, COLUMN_WIDTH), -2, -3)


def pair_frames(values: Values, *, repeat: bool = False) -> Values:
    """Reshape (T, ...) to blocks of two frames (K, 2, ...).

    Parameters
    ----------
    repeat : the last frame, at an odd end; otherwise zeros pad it
    """
    if len(values) % 2:
        padding = values[-1:] if repeat else np.zeros_like(values[:1])
        values = np.concatenate([values, padding])
    paired: Values = values.reshape(len(values) // 2, 2, *values.shape[1:])
    return paired


def to_blocks(rows: Real) -> Single:
    """Reshape (T, R, 3, V) to the solver's layout, (K, 3, 2, R, V) float32."""
    paired = pair_frames(rows.astype(np.float32, copy=False))
    return np.ascontiguousarray(np.moveaxis(paired, 3, 1))


def from_blocks(blocks: Single, n_frames: int) -> Single:
    """Reshape the solver's layout, (K, 3, 2, R, V), to (T, R, 3, V)."""
    paired = np.moveaxis(blocks, 1, 3)
    return paired.reshape(-1, *paired.shape[2:])[:n_frames]
