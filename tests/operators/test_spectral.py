"""Truth: sums of exponentials written out, torch's FFT, and trigonometric polynomials."""

import math

import pytest
import torch

from pacmo_core.operators.spectral import (
    analysis_matrix,
    interpolation_matrix,
    n_resolved_modes,
    periodic_extension_matrix,
    resampling_matrix,
    synthesis_matrix,
)


def polynomial(phases: torch.Tensor, n_modes: int) -> torch.Tensor:
    random = torch.Generator().manual_seed(n_modes)
    a, b = torch.randn(2, n_modes, generator=random, dtype=torch.float64)
    angle = 2 * math.pi * torch.outer(phases, torch.arange(n_modes, dtype=torch.float64))
    return angle.cos() @ a + angle.sin() @ b


def grid(n: int) -> torch.Tensor:
    return torch.arange(n, dtype=torch.float64) / n


@pytest.mark.parametrize("n", [7, 8, 40])
def test_analysis_is_the_fast_fourier_transform(n: int) -> None:
    values = torch.randn(n, generator=torch.Generator().manual_seed(n), dtype=torch.float64)
    n_modes = n_resolved_modes(n)
    pairs = (analysis_matrix(n, n_modes) @ values).view(n_modes, 2)
    torch.testing.assert_close(
        torch.view_as_complex(pairs), torch.fft.rfft(values, norm="forward")[:n_modes]
    )


@pytest.mark.parametrize("n", [21, 40])
def test_synthesis_undoes_analysis_of_a_polynomial_at_any_instant(n: int) -> None:
    at = torch.rand(30, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    values = polynomial(grid(n), 6)
    torch.testing.assert_close(interpolation_matrix(at, n) @ values, polynomial(at, 6))
    torch.testing.assert_close(
        synthesis_matrix(at, 6) @ analysis_matrix(n, 6) @ values, polynomial(at, 6)
    )


@pytest.mark.parametrize(("n_in", "n_out"), [(40, 30), (30, 40), (13, 40), (40, 13), (20, 20)])
def test_resampling_keeps_what_both_grids_resolve(n_in: int, n_out: int) -> None:
    torch.testing.assert_close(
        resampling_matrix(n_in, n_out) @ polynomial(grid(n_in), 6), polynomial(grid(n_out), 6)
    )


def test_more_modes_than_a_grid_resolves_are_refused() -> None:
    with pytest.raises(ValueError, match="resolve 4 modes"):
        analysis_matrix(8, 5)


def test_an_extension_keeps_the_function_and_joins_value_and_slope() -> None:
    n_points, n_latent = 4001, 5000
    t = torch.linspace(0, 1, n_points, dtype=torch.float64)
    closed = periodic_extension_matrix(n_points, n_latent) @ (t**2 - 0.3 * t)
    torch.testing.assert_close(closed[:n_points], t**2 - 0.3 * t)
    slope = (closed.roll(-1) - closed) * (n_points - 1)
    torch.testing.assert_close(slope[n_points - 1].item(), 1.7, atol=0.02, rtol=0)
    torch.testing.assert_close(slope[-1].item(), -0.3, atol=0.02, rtol=0)
    assert slope.diff().abs().max() < 0.5  # no jump anywhere


def test_an_extension_of_a_constant_is_that_constant() -> None:
    closed = periodic_extension_matrix(33, 40) @ torch.ones(33, dtype=torch.float64)
    torch.testing.assert_close(closed, torch.ones(40, dtype=torch.float64))
