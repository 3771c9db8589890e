"""The critic: a functional of reaction and partner, and its gradient's norm (PaCMO, eqs. 1, 2)."""

from collections.abc import Callable

import torch
from torch import Tensor, nn

from pacmo_core.operators.functional import FunctionalLayer
from pacmo_core.operators.uno import Uno, UnoConfig
from pacmo_core.pacmo.normalisation import Normalisation


class Critic(nn.Module):
    """``D: U x C -> R``, a U-NO of one output channel under a functional layer.

    Works on normalised motions: its Lipschitz bound is in units of the data's own spread.

    Parameters
    ----------
    config : UnoConfig
    normalisation : Normalisation, shared with the generator
    hidden : units of the functional's kernel network
    """

    points: Tensor

    def __init__(self, config: UnoConfig, normalisation: Normalisation, *, hidden: int) -> None:
        super().__init__()
        self.uno = Uno(config)
        self.functional = FunctionalLayer(hidden=hidden)
        self.normalisation = normalisation
        self.register_buffer("points", torch.linspace(0, 1, config.n_points), persistent=False)

    def forward(self, reaction: Tensor, partner: Tensor, log_duration: Tensor) -> Tensor:
        """Judge normalised motions ``(B, N, 3 J)``: ``(B,)``."""
        period = self.uno.config.period
        context = self.normalisation.context(self.points, log_duration, period)
        value = self.uno(torch.cat([reaction, partner, context], dim=-1))
        judged: Tensor = self.functional(value[..., 0], self.points)
        return judged


def gradient_norm(
    judge: Callable[[Tensor, Tensor], Tensor], reaction: Tensor, partner: Tensor, weights: Tensor
) -> Tensor:
    """Take the norm of a functional's derivative in the dual of the product of two L2 spaces.

    ``||dd||^2 = sum_t (|dd/du_t|^2 + |dd/dc_t|^2) / w_t``: a derivative with respect to a sample
    is the derivative function times the sample's weight. Unlike GANO's form, it does not change
    with the number of samples.

    Parameters
    ----------
    judge : (reaction, partner) to (B,)
    reaction, partner : (B, T, C)
    weights : (T,), of the quadrature

    Returns
    -------
    (B,), differentiable
    """
    u, c = reaction.detach().requires_grad_(), partner.detach().requires_grad_()
    gradients = torch.autograd.grad(judge(u, c).sum(), (u, c), create_graph=True)
    density = torch.cat(gradients, dim=-1).square().sum(dim=-1) / weights
    return density.sum(dim=-1).sqrt()
