"""Truth: integrals of broken lines and of trigonometric functions."""

import pytest
import torch

from pacmo_core.operators.quadrature import FunctionalLayer, trapezoid_weights
from pacmo_core.operators.spectral import initialise_weights


def random_times(n: int) -> torch.Tensor:
    inner = torch.rand(n - 2, generator=torch.Generator().manual_seed(n), dtype=torch.float64)
    ends = torch.tensor([0.0, 1.0], dtype=torch.float64)
    return torch.cat([ends[:1], inner.sort().values, ends[1:]])


def test_weights_integrate_a_line_exactly_at_any_times() -> None:
    times = random_times(17)
    integral = (trapezoid_weights(times) * (3 * times - 1)).sum()
    assert integral.item() == pytest.approx(0.5, abs=1e-12)


def test_weights_of_a_batch_are_those_of_its_rows() -> None:
    rows = torch.stack([random_times(9), random_times(9).square()])
    single = torch.stack([trapezoid_weights(row) for row in rows])
    assert torch.equal(trapezoid_weights(rows), single)


def test_times_that_stand_still_are_refused() -> None:
    with pytest.raises(ValueError, match="increase"):
        trapezoid_weights(torch.tensor([0.0, 0.5, 0.5]))
    with pytest.raises(ValueError, match="at least two"):
        trapezoid_weights(torch.tensor([0.0]))


def test_a_functional_does_not_depend_on_the_resolution() -> None:
    layer = FunctionalLayer(hidden=16)
    initialise_weights(layer, torch.Generator().manual_seed(0))

    def judge(times: torch.Tensor) -> float:
        times = times.float()
        return layer((2 + torch.sin(5 * times))[None], times).item()

    fine = judge(torch.linspace(0, 1, 4001))
    for times in (torch.linspace(0, 1, 65), torch.linspace(0, 1, 257), random_times(400)):
        assert judge(times) == pytest.approx(fine, rel=1e-3)
