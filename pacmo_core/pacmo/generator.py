"""The conditional generator: a random field and a partner's motion to a reaction (PaCMO, 3.2)."""

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from pacmo_core.operators.random_field import RandomField
from pacmo_core.operators.uno import Uno, UnoConfig
from pacmo_core.pacmo.functions import MotionPairs
from pacmo_core.pacmo.normalisation import Normalisation
from pacmo_core.skeleton import Skeleton


@dataclass(frozen=True)
class GeneratorConfig:
    """A generator's skeleton, operator and noise."""

    skeleton: Skeleton
    uno: UnoConfig
    noise: RandomField
    noise_channels: int


class Generator(nn.Module):
    """``G: A x M -> M`` as a U-NO; metres in, metres out, in the partner's first frame.

    Parameters
    ----------
    config : GeneratorConfig
    """

    points: Tensor

    def __init__(self, config: GeneratorConfig) -> None:
        super().__init__()
        self.config = config
        self.uno = Uno(config.uno)
        self.normalisation = Normalisation(channels=config.uno.out_channels)
        self.register_buffer("points", torch.linspace(0, 1, config.uno.n_points), persistent=False)

    @property
    def skeleton(self) -> Skeleton:
        """Whose joints go in and come out."""
        return self.config.skeleton

    def draw(self, n: int, random: torch.Generator) -> Tensor:
        """Draw ``(n, k, 2 K)`` coefficients of noise, on the generator's device."""
        return self.config.noise.draw(n, self.config.noise_channels, random=random)

    def forward(self, noise: Tensor, partner: Tensor, log_duration: Tensor) -> Tensor:
        """React on the grid.

        Parameters
        ----------
        noise : (B, k, 2 K), of ``draw``
        partner : (B, N, 3 J), metres
        log_duration : (B,)

        Returns
        -------
        (B, N, 3 J), metres
        """
        out: Tensor = self.uno(self._inputs(noise, partner, log_duration, self.points))
        return self.normalisation.metres(out)

    def latent(self, noise: Tensor, partner: Tensor, log_duration: Tensor) -> Tensor:
        """Apply all but the head: ``(L, B, C)``, to be read with ``at``."""
        return self.uno.trunk(self._inputs(noise, partner, log_duration, self.points))

    def at(
        self, latent: Tensor, noise: Tensor, partner: Tensor, log_duration: Tensor, times: Tensor
    ) -> Tensor:
        """React at any instants ``(T,)`` of [0, 1], where ``partner`` is ``(B, T, 3 J)`` metres."""
        inputs = self._inputs(noise, partner, log_duration, times)
        evaluation = self.uno.evaluation(times).to(latent.device)
        return self.normalisation.metres(self.uno.evaluate(latent, inputs, evaluation))

    def _inputs(
        self, noise: Tensor, partner: Tensor, log_duration: Tensor, times: Tensor
    ) -> Tensor:
        context = self.normalisation.context(times, log_duration, self.config.uno.period)
        field = self.config.noise.evaluate(noise, times)
        return torch.cat([field, self.normalisation.partner(partner), context], dim=-1)


def react_on_grid(model: Generator, pairs: MotionPairs, random: torch.Generator) -> Tensor:
    """Draw one reaction for each partner: ``(B, N, 3 J)`` metres."""
    noise = model.draw(len(pairs), random).to(pairs.partner.device)
    out: Tensor = model(noise, pairs.partner, pairs.log_duration)
    return out
