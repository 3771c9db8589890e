"""What a character's variational auto-encoder is given and gives, whatever is inside."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor, nn

from pacmo_core.skeleton_prior.placing import Tree
from pacmo_core.skeleton_prior.relations import asked_shift


@dataclass(frozen=True)
class Given:
    """All that a character's motion rests on.

    Parameters
    ----------
    template : (B, T, J, 3), metres: its own motion at scale 1
    scales : (B, J), of its own bones
    partner : (B, T, J, 3), metres: the partner as it moves by now
    partner_template : (B, T, J, 3), metres
    partner_scales : (B, J)
    unit : metres, the size of changes in the data
    tree : what places joints by bones
    """

    template: Tensor
    scales: Tensor
    partner: Tensor
    partner_template: Tensor
    partner_scales: Tensor
    unit: Tensor
    tree: Tree

    @cached_property
    def starting_field(self) -> Tensor:
        """``(B, T, J, 3)``: the field of bones that stands before anything is learnt."""
        change = self.partner - self.partner_template
        shift = asked_shift(self.template, self.partner_template, change)
        return self.tree.starting_field(shift, self.template, self.scales)

    @cached_property
    def starting_motion(self) -> Tensor:
        """``(B, T, J, 3)``, metres: where that field places joints."""
        placed: Tensor = self.tree(self.starting_field, self.template, self.scales)
        return placed


@dataclass(frozen=True)
class Code:
    """A Gaussian over latents: means and logarithms of variances, of one shape."""

    mean: Tensor
    log_variance: Tensor

    def draw(self, random: torch.Generator) -> Tensor:
        """Draw from it, so that gradients reach both."""
        noise = torch.randn(self.mean.shape, generator=random).to(self.mean.device)
        return self.mean + noise * (0.5 * self.log_variance).exp()

    def divergence(self) -> Tensor:
        """Measure its Kullback-Leibler divergence from N(0, I), mean over elements, nats."""
        variance = self.log_variance.exp()
        return 0.5 * (self.mean.square() + variance - 1 - self.log_variance).mean()


class Gaussian(nn.Module):
    """The two heads of an encoder: the tables have one dense layer where a VAE needs two."""

    def __init__(self, in_channels: int, out_channels: int) -> None:
        super().__init__()
        self.mean = nn.Linear(in_channels, out_channels)
        self.log_variance = nn.Linear(in_channels, out_channels)

    def forward(self, x: Tensor) -> Code:
        """``(..., C)`` to a code ``(..., D)``."""
        return Code(self.mean(x), self.log_variance(x).clamp(-10, 4))


class Character(nn.Module, ABC):
    """One character's VAE; ``place`` is what turns its field into joints' places."""

    place: nn.Module

    @abstractmethod
    def encode(self, motion: Tensor, given: Given, random: torch.Generator | None) -> Code:
        """Encode ``(B, T, J, 3)`` metres."""

    @abstractmethod
    def decode(self, latent: Tensor, given: Given) -> Tensor:
        """Decode latents into a field ``(B, T, J, 3)``."""

    @abstractmethod
    def latent_shape(self, given: Given) -> tuple[int, ...]:
        """Say what shape latents have."""
