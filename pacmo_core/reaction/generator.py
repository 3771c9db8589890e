"""The conditional generator: a random field and a partner's motion to a reaction (PaCMO, 3.2)."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.operators.random_field import GaussianRandomField
from pacmo_core.operators.uno import Uno, UnoConfig, uno_config_from_dict
from pacmo_core.reaction.data import Condition, MotionPairs
from pacmo_core.reaction.inputs import ActionEmbedding, Normalisation


@dataclass(frozen=True)
class GeneratorConfig:
    """A generator's skeleton, operator, noise and labels.

    Parameters
    ----------
    skeleton : Skeleton
    uno : UnoConfig
    noise : RandomField
    noise_channels : of the random field; 0 for a deterministic regression
    actions : labels that the reaction is conditioned on beside the partner; none in the usual case
    action_channels : of the labels' functions
    """

    skeleton: Skeleton
    uno: UnoConfig
    noise: GaussianRandomField
    noise_channels: int
    actions: tuple[str, ...]
    action_channels: int


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
        n_actions, channels = len(config.actions), config.action_channels
        self.labels = ActionEmbedding(n_actions=n_actions, channels=channels) if n_actions else None
        self.register_buffer("points", torch.linspace(0, 1, config.uno.n_points), persistent=False)

    @property
    def skeleton(self) -> Skeleton:
        """Whose joints go in and come out."""
        return self.config.skeleton

    def draw(self, n: int, random: torch.Generator) -> Tensor:
        """Draw ``(n, k, 2 K)`` coefficients of noise, on the generator's device."""
        return self.config.noise.draw(n, self.config.noise_channels, random=random)

    def forward(self, noise: Tensor, condition: Condition) -> Tensor:
        """React on the grid.

        Parameters
        ----------
        noise : (B, k, 2 K), of ``draw``
        condition : the partner on the grid, N instants

        Returns
        -------
        (B, N, 3 J), metres
        """
        out: Tensor = self.uno(self._inputs(noise, condition, self.points))
        return self.normalisation.metres(out)

    def latent(self, noise: Tensor, condition: Condition) -> Tensor:
        """Apply all but the head: ``(L, B, C)``, to be read with ``at``."""
        return self.uno.trunk(self._inputs(noise, condition, self.points))

    def at(self, latent: Tensor, noise: Tensor, condition: Condition, times: Tensor) -> Tensor:
        """React at any instants ``(T,)`` of [0, 1], at which the condition's partner is given."""
        inputs = self._inputs(noise, condition, times)
        evaluation = self.uno.evaluation(times).to(latent.device)
        return self.normalisation.metres(self.uno.evaluate(latent, inputs, evaluation))

    def _inputs(self, noise: Tensor, condition: Condition, times: Tensor) -> Tensor:
        period = self.config.uno.period
        field = self.config.noise.evaluate(noise, times)
        context = self.normalisation.context(times, condition.log_duration, period)
        parts = [field, self.normalisation.partner(condition.partner), context]
        if self.labels is not None:
            parts.append(self.labels(condition.action, times, period))
        return torch.cat(parts, dim=-1)


def react_on_grid(model: Generator, pairs: MotionPairs, random: torch.Generator) -> Tensor:
    """Draw one reaction for each partner: ``(B, N, 3 J)`` metres."""
    noise = model.draw(len(pairs), random).to(pairs.partner.device)
    out: Tensor = model(noise, pairs.condition)
    return out


def generator_from_state(config: Mapping[str, Any], state: Mapping[str, Tensor]) -> Generator:
    """Rebuild a model from what ``config`` and ``fit.state`` gave."""
    parts = GeneratorConfig(
        skeleton=Skeleton.from_dict(config["skeleton"]),
        uno=uno_config_from_dict(config["uno"]),
        noise=GaussianRandomField(**config["noise"]),
        noise_channels=config["noise_channels"],
        actions=tuple(config["actions"]),
        action_channels=config["action_channels"],
    )
    model = Generator(parts)
    model.load_state_dict(dict(state))
    return model.requires_grad_(False)
