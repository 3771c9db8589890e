"""Truth: the integral operator as a loop over modes; what GELU does to sums."""

import cmath
import math

import pytest
import torch

from pacmo_core.operators.spectral import OperatorLayer, SpectralLayer, initialise_weights
from pacmo_core.operators.uno import Uno, UnoConfig, u_shape_channels

RATIOS = (0.75, 0.5, 0.25, 0.25, 0.5, 0.75, 1.0)


def operator(*, skips: bool = True, n_points: int = 17) -> Uno:
    config = UnoConfig(
        in_channels=5,
        out_channels=2,
        lifting=8,
        channels=u_shape_channels(8),
        modes=(8, 6, 4, 4, 4, 6, 8),
        ratios=RATIOS,
        n_points=n_points,
        period=1.25,
        skips=skips,
    )
    uno = Uno(config)
    initialise_weights(uno, torch.Generator().manual_seed(0))
    return uno


def looped(v: torch.Tensor, weight: torch.Tensor, n_out: int) -> torch.Tensor:
    """Apply the kernel operator one mode, one point and one channel at a time."""
    n_in, n_modes, c_out = len(v), len(weight), weight.shape[-1]
    out = torch.zeros(n_out, c_out)
    for k in range(n_modes):
        kernel = torch.complex(weight[k, :, 0], weight[k, :, 1])
        coefficient = sum(v[j] * cmath.exp(-2j * math.pi * k * j / n_in) for j in range(n_in))
        mixed = coefficient / n_in @ kernel
        for j in range(n_out):
            wave = mixed * cmath.exp(2j * math.pi * k * j / n_out)
            out[j] += wave.real * (1 if k == 0 else 2)
    return out


@pytest.mark.parametrize(("n_in", "n_out"), [(20, 15), (10, 20), (12, 12)])
def test_a_spectral_layer_is_the_loop_over_its_modes(n_in: int, n_out: int) -> None:
    layer = SpectralLayer(in_channels=3, out_channels=4, n_in=n_in, n_out=n_out, n_modes=4)
    layer.initialise(torch.Generator().manual_seed(1))
    v = torch.randn(n_in, 2, 3, generator=torch.Generator().manual_seed(2))
    with torch.no_grad():
        out = layer(v)
        for b in range(2):
            torch.testing.assert_close(out[:, b], looped(v[:, b], layer.weight, n_out))


def test_modes_are_cut_down_to_what_both_grids_resolve() -> None:
    layer = SpectralLayer(in_channels=1, out_channels=1, n_in=40, n_out=10, n_modes=24)
    assert layer.n_modes == 5


@pytest.mark.parametrize("skips", [True, False])
def test_each_layer_and_the_whole_are_not_additive(skips: bool) -> None:
    random = torch.Generator().manual_seed(0)
    layer = OperatorLayer(in_channels=3, out_channels=3, n_in=20, n_out=10, n_modes=4)
    initialise_weights(layer, random)
    a, b = torch.randn(2, 20, 4, 3, generator=random)
    uno = operator(skips=skips)
    c, d = torch.randn(2, 4, 17, 5, generator=random)
    for network, x, y in ((layer, a, b), (uno, c, d)):
        both = network(x + y) - network(y) - network(x) + network(torch.zeros_like(x))
        assert both.norm() > 0.01 * (network(x) - network(y)).norm()


@pytest.mark.parametrize("skips", [True, False])
def test_evaluating_on_the_grid_is_the_forward_pass(skips: bool) -> None:
    uno = operator(skips=skips)
    v = torch.randn(3, 17, 5, generator=torch.Generator().manual_seed(0))
    times = torch.linspace(0, 1, 17)
    out = uno.evaluate(uno.trunk(v), v, uno.evaluation(times))
    torch.testing.assert_close(out, uno(v), atol=1e-5, rtol=1e-5)


def test_rows_of_a_batch_do_not_see_each_other() -> None:
    uno = operator()
    v = torch.randn(6, 17, 5, generator=torch.Generator().manual_seed(0))
    alone = torch.cat([uno(row[None]) for row in v])
    torch.testing.assert_close(uno(v), alone, atol=1e-6, rtol=1e-5)


def test_the_bottleneck_lies_on_a_quarter_of_the_latent_grid() -> None:
    hidden = operator(n_points=33).bottleneck(torch.zeros(2, 33, 5), 4)
    assert hidden.shape == (10, 2, 32)


@pytest.mark.parametrize(
    ("change", "message"),
    [({"n_points": 16}, "whole"), ({"period": 1.0}, "exceed 1"), ({"modes": (4,)}, "as many")],
)
def test_shapes_that_do_not_fit_are_refused(change: dict[str, object], message: str) -> None:
    facts = vars(operator().config) | change
    with pytest.raises(ValueError, match=message):
        UnoConfig(**facts)


def test_fresh_weights_come_from_the_generator_alone() -> None:
    first, second = operator(), operator()
    for a, b in zip(first.parameters(), second.parameters(), strict=True):
        assert torch.equal(a, b)
    with pytest.raises(ValueError, match="LayerNorm"):
        initialise_weights(torch.nn.LayerNorm(3), torch.Generator())
