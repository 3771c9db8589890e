"""The critic, a functional of reaction and partner, and its gradient penalty (PaCMO, eqs. 1, 2).

The critic approximates the functional whose difference between real and generated data is the
Wasserstein distance (Kantorovich-Rubinstein duality); the gradient penalty of Gulrajani et al.
(2017), *Improved training of Wasserstein GANs*, keeps its Lipschitz constant near one.
"""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.operators.quadrature import FunctionalLayer
from pacmo_core.operators.uno import Uno, UnoConfig
from pacmo_core.reaction.data import Condition
from pacmo_core.reaction.inputs import ActionEmbedding, Normalisation

# Metres: distances below the first are rounded off, the second is subtracted to centre them.
DISTANCE_SOFTENING, DISTANCE_OFFSET = 0.05, 1.0


@dataclass(frozen=True)
class CriticInputs:
    """What the critic takes in beside motions, duration and time.

    Parameters
    ----------
    end_effectors : joints whose distances between the bodies are inputs; none in the paper
    actions : embedding of action labels, if these are a condition
    """

    end_effectors: tuple[int, ...]
    actions: ActionEmbedding | None

    @property
    def channels(self) -> int:
        """Number of channels of these inputs."""
        return len(self.end_effectors) ** 2 + (self.actions.channels if self.actions else 0)


class Critic(nn.Module):
    """``D: U x C -> R``, a U-NO of one output channel followed by a functional layer.

    It takes normalised motions, so its Lipschitz constant is in units of the data's own scale.

    Parameters
    ----------
    config : UnoConfig; its input channels are 6 J + 3 and those of ``inputs``
    normalisation : Normalisation, shared with the generator
    inputs : beside positions, duration and time
    hidden : units of the functional's kernel network
    """

    points: Tensor

    def __init__(
        self,
        config: UnoConfig,
        normalisation: Normalisation,
        inputs: CriticInputs,
        *,
        hidden: int,
    ) -> None:
        super().__init__()
        self.end_effectors = list(inputs.end_effectors)
        self.actions = inputs.actions
        self.uno = Uno(config)
        self.functional = FunctionalLayer(hidden=hidden)
        self.normalisation = normalisation
        self.register_buffer("points", torch.linspace(0, 1, config.n_points), persistent=False)

    def forward(self, reaction: Tensor, condition: Condition) -> Tensor:
        """Score reactions ``(B, N, 3 J)``, normalised as is the condition's partner: ``(B,)``."""
        period, partner = self.uno.config.period, condition.partner
        times = self.normalisation.time_and_duration(self.points, condition.log_duration, period)
        inputs = [reaction, partner, times]
        if self.end_effectors:
            inputs.append(self._distances(reaction, partner))
        if self.actions is not None:
            inputs.append(self.actions(condition.action, self.points, period))
        value = self.uno(torch.cat(inputs, dim=-1))
        score: Tensor = self.functional(value[..., 0], self.points)
        return score

    def _distances(self, reaction: Tensor, partner: Tensor) -> Tensor:
        """``(B, N, E^2)``: distances between end effectors of the two bodies, of order one."""
        normalisation = self.normalisation
        first, second = (
            motion.view(*motion.shape[:-1], -1, 3)[:, :, self.end_effectors]
            for motion in (
                normalisation.denormalise_reaction(reaction),
                normalisation.denormalise_partner(partner),
            )
        )
        squared = (first[:, :, :, None] - second[:, :, None]).square().sum(dim=-1)
        # Softened: the square root is not differentiable at zero, where bodies touch.
        distances = (squared + DISTANCE_SOFTENING**2).sqrt().flatten(2)
        scaled: Tensor = (distances - DISTANCE_OFFSET) / normalisation.scale
        return scaled


def end_effectors(skeleton: Skeleton) -> tuple[int, ...]:
    """List the root and the joints without children: head, hands and feet."""
    return (skeleton.root, *skeleton.end_effectors)


def gradient_penalty(
    critic: Callable[[Tensor, Tensor], Tensor], reaction: Tensor, partner: Tensor, weights: Tensor
) -> tuple[Tensor, Tensor]:
    """Return the gradient penalty ``E (||dD|| - 1)^2`` (PaCMO, eq. 2) and the mean norm.

    Parameters
    ----------
    critic, reaction, partner, weights : see ``gradient_norm``; ``reaction`` lies at random between
        generated and real motions, ``epsilon u + (1 - epsilon) G(a, c)``

    Returns
    -------
    two of (), differentiable
    """
    norms = gradient_norm(critic, reaction, partner, weights)
    return (norms - 1).square().mean(), norms.mean()  # eq. 2


def gradient_norm(
    critic: Callable[[Tensor, Tensor], Tensor], reaction: Tensor, partner: Tensor, weights: Tensor
) -> Tensor:
    """Return the norm of a functional's derivative in the dual of the product of two L2 spaces.

    ``||dD||^2 = sum_t (|dD/du_t|^2 + |dD/dc_t|^2) / w_t``: the derivative with respect to a sample
    is the derivative function times the sample's quadrature weight. Unlike the form in GANO (Rahman
    et al. 2022), it does not change with the number of samples.

    Parameters
    ----------
    critic : (reaction, partner) to (B,)
    reaction, partner : (B, T, C)
    weights : (T,), of the quadrature

    Returns
    -------
    (B,), differentiable
    """
    u, c = reaction.detach().requires_grad_(), partner.detach().requires_grad_()
    gradients = torch.autograd.grad(critic(u, c).sum(), (u, c), create_graph=True)
    density = torch.cat(gradients, dim=-1).square().sum(dim=-1) / weights
    return density.sum(dim=-1).sqrt()
