"""The network that tells which partner a reaction answers.

Two operators turn the partner's and the reaction's motion into functions of time; both are of unit
length in L²(time), and a reaction fits a partner as well as the two functions agree.
"""

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.operators.fourier import interpolation
from pacmo_core.operators.uno import Uno, UnoConfig
from pacmo_core.reaction.functions import MotionPairs
from pacmo_core.reaction.normalisation import Normalisation


@dataclass(frozen=True)
class MatcherConfig:
    """A matcher's skeleton, the operator of either side and how sharply it chooses."""

    skeleton: Skeleton
    uno: UnoConfig
    n_instants: int
    temperature: float


class Matcher(nn.Module):
    """Embed partners and reactions so that those of one interaction lie close.

    Parameters
    ----------
    config : MatcherConfig
    """

    points: Tensor
    evaluation: Tensor

    def __init__(self, config: MatcherConfig) -> None:
        super().__init__()
        self.config = config
        self.partner, self.reaction = Uno(config.uno), Uno(config.uno)
        self.normalisation = Normalisation(channels=config.uno.in_channels - 3)
        self.register_buffer("points", torch.linspace(0, 1, config.uno.n_points), persistent=False)
        r = config.n_instants
        midpoints = (torch.arange(r) + 0.5) / r
        evaluation = interpolation(midpoints / config.uno.period, config.uno.sizes[-1]).float()
        self.register_buffer("evaluation", evaluation, persistent=False)

    def forward(self, pairs: MotionPairs) -> tuple[Tensor, Tensor]:
        """Embed both sides: two ``(B, r E)``, unit vectors whose product is the fit."""
        norm, period = self.normalisation, self.config.uno.period
        context = norm.context(self.points, pairs.log_duration, period)
        return (
            self._embedded(self.partner, norm.partner(pairs.partner), context),
            self._embedded(self.reaction, norm.reaction(pairs.reaction), context),
        )

    def loss(self, pairs: MotionPairs, clips: Tensor) -> Tensor:
        """Take the mean surprise at the true partner among those given, and at the true reaction.

        Parameters
        ----------
        pairs : B real pairs
        clips : (B,) the clip of each; the other person's view of a clip is no rival
        """
        partner, reaction = self(pairs)
        fit = partner @ reaction.T / self.config.temperature
        true = torch.arange(len(clips), device=clips.device)
        alike = (clips[:, None] == clips) & (true[:, None] != true)
        fit = fit.masked_fill(alike, -torch.inf)
        return (functional.cross_entropy(fit, true) + functional.cross_entropy(fit.T, true)) / 2

    def _embedded(self, operator: Uno, motion: Tensor, context: Tensor) -> Tensor:
        inputs = torch.cat([motion, context], dim=-1)
        values = operator.evaluate(operator.trunk(inputs), inputs, self.evaluation)
        return functional.normalize(values.flatten(1), dim=-1)
