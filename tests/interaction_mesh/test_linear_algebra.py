"""Reference: NumPy's product; the product of one column alone, byte for byte."""

import os
import subprocess
import sys

import numpy as np
import pytest

from pacmo_core.interaction_mesh.linear_algebra import COLUMN_WIDTH, batched_product, column_groups
from tests.docs import ROOT

# Of OpenBLAS on x86. The second rounds columns of a wide product by where they stand.
KERNELS = ["", "Haswell"]


@pytest.mark.parametrize("n_columns", [0, 1, COLUMN_WIDTH, COLUMN_WIDTH + 5, 3 * COLUMN_WIDTH])
@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_batched_product_equals_numpys_product(n_columns, kind):
    random = np.random.default_rng(0)
    matrix = random.normal(size=(7, 5)).astype(kind)
    columns = random.normal(size=(5, n_columns)).astype(kind)
    result = batched_product(matrix, columns)
    assert result.dtype == kind
    np.testing.assert_allclose(result, matrix @ columns, rtol=0, atol=1e-5)


def test_column_groups_share_memory():
    columns = np.zeros((2, 5, 2 * COLUMN_WIDTH))
    column_groups(columns)[1, 1, 3] = np.arange(COLUMN_WIDTH)
    assert columns[1, 3, COLUMN_WIDTH:].tolist() == list(range(COLUMN_WIDTH))
    assert np.count_nonzero(columns) == COLUMN_WIDTH - 1


def check_columns_are_independent() -> None:
    """Compare columns beside others with the same ones alone, and in another place."""
    random = np.random.default_rng(0)
    for size in (54, 88, 108):
        matrix = random.normal(size=(size, size)).astype(np.float32)
        columns = random.normal(size=(size, 6 * COLUMN_WIDTH)).astype(np.float32)
        result = batched_product(matrix, columns)
        order = random.permutation(6 * COLUMN_WIDTH)
        assert batched_product(matrix, columns[:, order]).tobytes() == result[:, order].tobytes()
        for selection in (slice(3, 4), slice(20, 61)):
            assert (
                batched_product(matrix, columns[:, selection]).tobytes()
                == result[:, selection].tobytes()
            )


@pytest.mark.parametrize("kernel", KERNELS)
def test_a_column_does_not_depend_on_the_other_columns(kernel):
    program = (
        "from tests.interaction_mesh import test_linear_algebra as tests\n"
        "tests.check_columns_are_independent()"
    )
    environment = {**os.environ, "OPENBLAS_CORETYPE": kernel}
    subprocess.run([sys.executable, "-c", program], env=environment, cwd=ROOT, check=True)
