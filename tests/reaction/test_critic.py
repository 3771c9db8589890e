"""Truth: linear functionals, whose derivative's norm is the norm of their kernel."""

import math
from dataclasses import replace

import pytest
import torch

from pacmo_core.data.skeleton import SBU15
from pacmo_core.operators.quadrature import trapezoid_weights
from pacmo_core.reaction import wgan
from pacmo_core.reaction.critic import end_effectors, gradient_norm
from tests.reaction.problems import PACMO, clips


def irregular(n: int) -> torch.Tensor:
    inner = torch.rand(n - 2, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    return torch.tensor([0.0, *inner.sort().values.tolist(), 1.0], dtype=torch.float64)


@pytest.mark.parametrize(
    "times",
    [torch.linspace(0, 1, n, dtype=torch.float64) for n in (33, 65, 257)] + [irregular(120)],
    ids=["33", "65", "257", "irregular"],
)
def test_the_norm_of_a_linear_functional_is_its_kernels_at_every_resolution(
    times: torch.Tensor,
) -> None:
    weights = trapezoid_weights(times)
    kernel = math.sqrt(2) * torch.sin(2 * math.pi * times)
    u = torch.randn(3, len(times), 1, generator=torch.Generator().manual_seed(1)).double()
    c = torch.zeros(3, len(times), 1, dtype=torch.float64)
    of_reaction = gradient_norm(
        lambda a, _b: (a[..., 0] * kernel) @ weights + 0 * _b.sum(), u, c, weights
    )
    # Over irregular times the quadrature of the kernel's square is itself only an approximation.
    expected = (kernel.square() @ weights).sqrt()
    torch.testing.assert_close(of_reaction, expected.expand(3), atol=1e-12, rtol=0)
    assert expected.item() == pytest.approx(1, abs=1e-12 if len(times) != 120 else 2e-2)


def test_the_norm_is_that_of_the_product_space() -> None:
    weights = trapezoid_weights(torch.linspace(0, 1, 33, dtype=torch.float64))
    u, c = torch.zeros(2, 1, 33, 2, dtype=torch.float64)
    norm = gradient_norm(lambda a, b: (3 * a[..., 0] + 4 * b[..., 1]) @ weights, u, c, weights)
    assert norm.item() == pytest.approx(5, abs=1e-12)


def test_the_norm_itself_has_a_gradient() -> None:
    weights = trapezoid_weights(torch.linspace(0, 1, 9))
    slope = torch.tensor(2.0, requires_grad=True)
    u = torch.ones(1, 9, 1)
    norm = gradient_norm(lambda a, b: slope * ((a + b)[..., 0] @ weights), u, u, weights)
    (found,) = torch.autograd.grad(norm.sum(), slope)
    assert found.item() == pytest.approx(math.sqrt(2), rel=1e-5)


def test_the_end_effectors_are_root_head_hands_and_feet() -> None:
    names = [SBU15.joints[joint] for joint in end_effectors(SBU15)]
    assert names == ["torso", "head", "left_hand", "right_hand", "left_foot", "right_foot"]


def test_the_critic_takes_in_distances_between_end_effectors() -> None:
    critic = wgan.build_training(clips(4), PACMO).trainer.critic
    norm = critic.normalisation
    metres = torch.randn(2, 1, 17, 45, generator=torch.Generator().manual_seed(0))
    seen = critic._distances(norm.normalise_reaction(metres[0]), norm.normalise_partner(metres[1]))
    ends = [motion.unflatten(-1, (15, 3))[:, :, list(end_effectors(SBU15))] for motion in metres]
    apart = torch.cdist(*ends).flatten(2)
    # A touch is five centimetres; elsewhere the distance itself.
    expected = (torch.hypot(apart, torch.tensor(0.05)) - 1) / norm.scale
    torch.testing.assert_close(seen, expected, atol=1e-4, rtol=1e-4)
    assert PACMO.body_distances
    plain = wgan.build_training(clips(4), replace(PACMO, body_distances=False)).trainer.critic
    assert plain.uno.config.in_channels == critic.uno.config.in_channels - 36
