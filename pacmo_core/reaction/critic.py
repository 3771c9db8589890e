"""The critic: a functional of reaction and partner, and its gradient's norm (PaCMO, eqs. 1, 2)."""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.operators.quadrature import FunctionalLayer
from pacmo_core.operators.uno import Uno, UnoConfig
from pacmo_core.reaction.data import Condition
from pacmo_core.reaction.inputs import ActionEmbedding, Normalisation

DISTANCE_SOFTENING, DISTANCE_OFFSET = 0.05, 1.0  # metres


@dataclass(frozen=True)
class CriticInputs:
    """What a critic may be shown beside the motions.

    Parameters
    ----------
    ends : joints whose distances from body to body it sees; none in the paper's plain form
    labels : the functions of action labels, if those are a condition
    """

    ends: tuple[int, ...]
    labels: ActionEmbedding | None

    @property
    def channels(self) -> int:
        """Of the functions that this adds."""
        return len(self.ends) ** 2 + (self.labels.channels if self.labels else 0)


class Critic(nn.Module):
    """``D: U x C -> R``, a U-NO of one output channel under a functional layer.

    Works on normalised motions: its Lipschitz bound is in units of the data's own spread.

    Parameters
    ----------
    config : UnoConfig; its input channels are 6 J + 3 and those of the conditions
    normalisation : Normalisation, shared with the generator
    conditions : what it is shown beside positions, duration and time
    hidden : units of the functional's kernel network
    """

    points: Tensor

    def __init__(
        self,
        config: UnoConfig,
        normalisation: Normalisation,
        conditions: CriticInputs,
        *,
        hidden: int,
    ) -> None:
        super().__init__()
        self.ends = list(conditions.ends)
        self.labels = conditions.labels
        self.uno = Uno(config)
        self.functional = FunctionalLayer(hidden=hidden)
        self.normalisation = normalisation
        self.register_buffer("points", torch.linspace(0, 1, config.n_points), persistent=False)

    def forward(self, reaction: Tensor, condition: Condition) -> Tensor:
        """Judge motions ``(B, N, 3 J)``, normalised, the partner's too: ``(B,)``."""
        period, partner = self.uno.config.period, condition.partner
        context = self.normalisation.context(self.points, condition.log_duration, period)
        shown = [reaction, partner, context]
        if self.ends:
            shown.append(self._distances(reaction, partner))
        if self.labels is not None:
            shown.append(self.labels(condition.action, self.points, period))
        value = self.uno(torch.cat(shown, dim=-1))
        judged: Tensor = self.functional(value[..., 0], self.points)
        return judged

    def _distances(self, reaction: Tensor, partner: Tensor) -> Tensor:
        """Measure ``(B, N, E^2)`` distances between the ends of the two bodies, of order one."""
        norm = self.normalisation
        one, other = (
            motion.view(*motion.shape[:-1], -1, 3)[:, :, self.ends]
            for motion in (norm.metres(reaction), norm.partner_metres(partner))
        )
        apart = (one[:, :, :, None] - other[:, :, None]).square().sum(dim=-1)
        # Bodies that touch have a distance of zero, whose root has no slope.
        near: Tensor = (
            (apart + DISTANCE_SOFTENING**2).sqrt().flatten(2) - DISTANCE_OFFSET
        ) / norm.scale
        return near


def end_effectors(skeleton: Skeleton) -> tuple[int, ...]:
    """List the root and the joints on which no other hangs: head, hands and feet."""
    inner = set(skeleton.parents)
    joints = range(len(skeleton.joints))
    return (skeleton.root, *(joint for joint in joints if joint not in inner))


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
