"""Products whose columns round alike, whatever stands beside them.

A BLAS may sum otherwise at the edges of a matrix than within it: OpenBLAS does where a processor
has AVX2 and no more (float32: the first and last eight columns of 32). A variation must not depend
on its company, so bodies stand in columns side by side and are multiplied ``WIDTH`` at a time, all
in products of the same shape.
"""

import numpy as np

from pacmo_core.interaction_mesh.scene import Real

WIDTH = 16


def filled(n_columns: int) -> int:
    """Round up to full width."""
    return -(-n_columns // WIDTH) * WIDTH


def product(matrices: Real, columns: Real) -> Real:
    """Multiply ``(R, N)`` or ``(..., R, N)`` and ``(..., N, C)``, filled up to full width."""
    n_columns = columns.shape[-1]
    full: Real = np.zeros((*columns.shape[:-1], filled(n_columns)), dtype=columns.dtype)
    full[..., :n_columns] = columns
    found: Real = np.zeros((*columns.shape[:-2], matrices.shape[-2], full.shape[-1]), full.dtype)
    np.matmul(matrices[..., None, :, :], in_parts(full), out=in_parts(found))
    return found[..., :n_columns]


def in_parts(columns: Real) -> Real:
    """See ``(..., N, C)``, C of full width, as ``(..., C / WIDTH, N, WIDTH)``: the same memory."""
    n_parts = columns.shape[-1] // WIDTH
    return np.moveaxis(columns.reshape(*columns.shape[:-1], n_parts, WIDTH), -2, -3)
