"""F-GCN: graph convolutions, one frame at a time (supplement, table 18)."""

from itertools import pairwise

import torch
from torch import Tensor, nn

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.skeleton_prior.autograd_functions import to_float32
from pacmo_core.skeleton_prior.kinematics import DisplacementOutput
from pacmo_core.skeleton_prior.layers import (
    GraphConvolution,
    batch_first,
    frames_first,
    off_diagonal_adjacency,
)
from pacmo_core.skeleton_prior.models.f_cnn import template_features
from pacmo_core.skeleton_prior.settings import PriorConfig
from pacmo_core.skeleton_prior.vae import (
    CharacterInputs,
    CharacterVae,
    DiagonalGaussian,
    SkeletonPrior,
)


class FGcnVae(CharacterVae):
    """F-GCN of a character: graph convolutions, joint by joint.

    Parameters
    ----------
    skeleton : Skeleton
    hidden : 256 in the paper's size
    first : whether it is told its body in 20 channels, or its partner in 16
    """

    def __init__(self, skeleton: Skeleton, *, hidden: int, first: bool) -> None:
        super().__init__()
        self.place, self.first, self.hidden = DisplacementOutput(), first, hidden
        links = off_diagonal_adjacency(skeleton)
        told = 20 if first else 16
        self.telling = nn.Linear(4 if first else 6, told)
        quarter, half = hidden // 4, hidden // 2
        self.before = _graph_convolutions(links, (3, hidden // 8, quarter))
        self.after = _graph_convolutions(links, (quarter + told, half))
        self.code = nn.ModuleList([GraphConvolution(links, half, hidden) for _ in range(2)])
        decoder = (hidden + told, hidden, half, quarter, hidden // 8)
        self.decoder = _graph_convolutions(links, decoder)
        self.last = GraphConvolution(links, hidden // 8, 3)
        self.out = nn.Linear(3, 3)

    def latent_shape(self, given: CharacterInputs) -> tuple[int, ...]:
        """One code a frame and joint."""
        return (*given.template.shape[:3], self.hidden)

    def encode(
        self, motion: Tensor, given: CharacterInputs, random: torch.Generator | None
    ) -> DiagonalGaussian:
        """Encode each frame's offsets."""
        del random  # nothing is dropped
        x = _apply_with_relu(self.before, frames_first((motion - given.template) / given.unit))
        x = _apply_with_relu(self.after, torch.cat([x, frames_first(self._told(given))], dim=-1))
        mean, log_variance = (batch_first(to_float32(layer(x))) for layer in self.code)
        return DiagonalGaussian(mean, log_variance.clamp(-10, 4))

    def decode(self, latent: Tensor, given: CharacterInputs) -> Tensor:
        """Decode each frame."""
        x = frames_first(torch.cat([latent, self._told(given)], dim=-1))
        field: Tensor = self.out(
            batch_first(to_float32(self.last(_apply_with_relu(self.decoder, x))))
        )
        return field * given.unit

    def _told(self, given: CharacterInputs) -> Tensor:
        both = torch.cat([given.partner, given.template], dim=-1)
        told: Tensor = self.telling(template_features(given) if self.first else both)
        return told


def _graph_convolutions(links: Tensor, channels: tuple[int, ...]) -> nn.ModuleList:
    pairs = pairwise(channels)
    return nn.ModuleList([GraphConvolution(links, a, b) for a, b in pairs])


def _apply_with_relu(layers: nn.ModuleList, x: Tensor) -> Tensor:
    for layer in layers:
        x = layer(x).relu()
    return x


def build(config: PriorConfig) -> SkeletonPrior:
    """Build F-GCN for both characters."""
    first, second = (
        FGcnVae(config.skeleton, hidden=config.hidden, first=first) for first in (True, False)
    )
    return SkeletonPrior(config, (first, second), both_roles=False)
