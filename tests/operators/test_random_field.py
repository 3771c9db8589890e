"""Truth: the covariance of the Gaussian process, written out as a sum over modes."""

import math

import pytest
import torch

from pacmo_core.operators.random_field import GaussianRandomField

FIELD = GaussianRandomField(alpha=2.0, tau=5.0, n_frequencies=32, period=1.25)


def covariance(lag: torch.Tensor) -> torch.Tensor:
    # Of all whole numbers, also the negative ones.
    k = 2 * math.pi * torch.arange(-31, 32, dtype=torch.float64) / 1.25
    power = (k**2 + 25.0) ** -2.0
    return torch.cos(lag[..., None] * k) @ (power / power.sum())


def draws(n: int, times: torch.Tensor) -> torch.Tensor:
    coefficients = FIELD.sample(n, 1, random=torch.Generator().manual_seed(0))
    return FIELD.evaluate(coefficients, times)[..., 0]


def test_the_basis_carries_the_covariance_exactly() -> None:
    times = torch.linspace(0, 1, 20, dtype=torch.float64)
    scaled = FIELD.basis(times).double() * FIELD.power().sqrt().repeat_interleave(2)
    expected = covariance(times[:, None] - times)
    torch.testing.assert_close(scaled @ scaled.T, expected, atol=1e-6, rtol=0)
    torch.testing.assert_close(expected.diagonal(), torch.ones(20, dtype=torch.float64))


def test_samples_have_zero_mean_unit_variance_and_that_covariance() -> None:
    times = torch.linspace(0, 1, 9)
    n = 20_000
    values = draws(n, times).double()
    sampled = values.T @ values / n
    expected = covariance((times[:, None] - times).double())
    # The variance of a product of two unit normals is at most 2; five standard errors.
    assert (sampled - expected).abs().max() < 5 * math.sqrt(2 / n)
    assert values.mean(dim=0).abs().max() < 5 / math.sqrt(n)


def test_one_draw_is_one_function_at_every_resolution() -> None:
    coarse, fine = torch.linspace(0, 1, 9), torch.linspace(0, 1, 17)
    assert torch.allclose(draws(4, coarse), draws(4, fine)[:, ::2], atol=1e-6)


def test_channels_are_independent_and_the_ends_are_not_tied() -> None:
    both = FIELD.sample(20_000, 2, random=torch.Generator().manual_seed(1))
    values = FIELD.evaluate(both, torch.tensor([0.3]))[:, 0]
    assert abs(values.prod(dim=-1).mean().item()) < 5 / math.sqrt(20_000)
    assert covariance(torch.tensor(1.0, dtype=torch.float64)).item() < 0.8


def test_the_field_repeats_after_its_period() -> None:
    assert torch.allclose(draws(2, torch.tensor([0.1])), draws(2, torch.tensor([1.35])), atol=1e-5)


def test_a_smoother_field_has_less_power_in_high_modes() -> None:
    rough = GaussianRandomField(alpha=1.0, tau=5.0, n_frequencies=32, period=1.25)
    assert FIELD.power()[8:].sum() < rough.power()[8:].sum()
    assert FIELD.power().sum().item() == pytest.approx(1)
