"""Products whose columns round alike, whatever stands beside them.

A BLAS may sum otherwise at the edges of a matrix than within it: OpenBLAS does where a processor
has AVX2 and no more (float32: the first and last eight columns of 32). A variation must not depend
on its company, so bodies stand in columns side by side and are multiplied ``WIDTH`` at a time, all
in products of the same shape.
"""

from contextlib import AbstractContextManager

import numpy as np
import scipy.linalg  # noqa: F401  # brings its BLAS, which the controller must find
from threadpoolctl import ThreadpoolController

from pacmo_core.interaction_mesh.scene import Real

COLUMN_WIDTH = 16


def padded_width(n_columns: int) -> int:
    """Round up to full width."""
    return -(-n_columns // COLUMN_WIDTH) * COLUMN_WIDTH


def batched_product(matrices: Real, columns: Real) -> Real:
    """Multiply ``(R, N)`` or ``(..., R, N)`` and ``(..., N, C)``, filled up to full width."""
    n_columns = columns.shape[-1]
    full: Real = np.zeros((*columns.shape[:-1], padded_width(n_columns)), dtype=columns.dtype)
    full[..., :n_columns] = columns
    found: Real = np.zeros((*columns.shape[:-2], matrices.shape[-2], full.shape[-1]), full.dtype)
    np.matmul(matrices[..., None, :, :], column_groups(full), out=column_groups(found))
    return found[..., :n_columns]


def column_groups(columns: Real) -> Real:
    """See ``(..., N, C)``, C of full width, as ``(..., C / WIDTH, N, WIDTH)``: the same memory."""
    n_parts = columns.shape[-1] // COLUMN_WIDTH
    return np.moveaxis(columns.reshape(*columns.shape[:-1], n_parts, COLUMN_WIDTH), -2, -3)


# FROM """Linear algebra on one thread: another number of threads rounds otherwise.
# FROM
# FROM The solver's matrices are small, and its callers have as many processes as cores.
# FROM """
_CONTROLLER = ThreadpoolController()


def single_blas_thread() -> AbstractContextManager[object]:
    """Hold BLAS to one thread meanwhile."""
    limits: AbstractContextManager[object] = _CONTROLLER.limit(limits=1, user_api="blas")
    return limits
