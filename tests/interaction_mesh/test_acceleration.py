"""Reference: the fixed point of a linear map, and least squares."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pacmo_core.interaction_mesh.acceleration import MEMORY, SAMPLE_EVERY, Iterates, combine

FIXED = settings(derandomize=True, deadline=None, max_examples=30)
N_BODIES = 16


def linear_map(rank: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a symmetric map ``v' = M v + b`` of four numbers a block with ``rank`` rates."""
    random = np.random.default_rng(seed)
    basis, _ = np.linalg.qr(random.normal(size=(4, 4)))
    rates = np.zeros(4)
    rates[:rank] = random.permutation([0.95, 0.75])[:rank]
    return basis * rates @ basis.T, random.normal(size=4)


@FIXED
@given(rank=st.integers(1, 2), seed=st.integers(0, 1000))
def test_the_combination_is_the_fixed_point_of_a_map_with_few_rates(rank: int, seed: int) -> None:
    matrix, offset = linear_map(rank, seed)
    fixed_point = np.linalg.solve(np.eye(4) - matrix, offset)
    # The same in every block, as only some are sampled.
    start = np.random.default_rng(seed).normal(size=(1, 4, N_BODIES)).astype(np.float32)
    values = np.repeat(start, 2 * SAMPLE_EVERY, axis=0)
    iterates = Iterates((values,), (np.ones((len(values), 1, 1), np.float32),))
    before = np.abs(values - fixed_point[:, None]).max()
    for _ in range(MEMORY):
        values = np.einsum("ij,kjv->kiv", matrix, values) + offset[:, None]
        values = values.astype(np.float32)
        iterates.add((values,))
    plain = np.abs(values - fixed_point[:, None]).max()
    iterates.move((values,))
    after = np.abs(values - fixed_point[:, None]).max()
    assert after < 0.2 * plain + 1e-4 * before


def test_coefficients_minimise_the_step_among_those_of_sum_one() -> None:
    random = np.random.default_rng(0)
    steps = random.normal(size=(MEMORY, 50))
    (found,) = combine((steps @ steps.T)[None])
    # Eliminate the last coefficient: an ordinary least-squares problem.
    others, *_ = np.linalg.lstsq((steps[:-1] - steps[-1]).T, -steps[-1], rcond=None)
    np.testing.assert_allclose(found, [*others, 1 - others.sum()], rtol=1e-5)


def test_a_body_that_does_not_move_stays() -> None:
    values = np.random.default_rng(0).normal(size=(8, 3, N_BODIES)).astype(np.float32)
    iterates = Iterates((values,), (np.ones((8, 1, 1), np.float32),))
    for _ in range(MEMORY):
        iterates.add((values,))
    moved = values.copy()
    iterates.move((moved,))
    np.testing.assert_allclose(moved, values, atol=1e-6)
    assert not iterates.is_full


@pytest.mark.parametrize("kept", [[3, 5] * 8, [15] * 16])
def test_a_body_is_combined_alike_whatever_stands_beside_it(kept: list[int]) -> None:
    random = np.random.default_rng(1)
    penalties = random.uniform(1, 9, size=(8, 3, 1)).astype(np.float32)
    first = random.normal(size=(8, 3, N_BODIES)).astype(np.float32)
    columns = np.array(kept)
    whole, part = Iterates((first,), (penalties,)), Iterates((first,), (penalties,))
    part.select(columns)
    for _ in range(MEMORY):
        values = random.normal(size=first.shape).astype(np.float32)
        whole.add((values,))
        part.add((values[..., columns],))
    of_whole, of_part = values.copy(), np.ascontiguousarray(values[..., columns])
    whole.move((of_whole,))
    part.move((of_part,))
    np.testing.assert_array_equal(of_whole[..., columns], of_part)
