"""F-GCN: a baseline of graph convolutions over the joints of one frame (supplement, table 18)."""

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
from pacmo_core.skeleton_prior.settings import PriorConfig
from pacmo_core.skeleton_prior.vae import (
    CharacterInputs,
    CharacterVae,
    DiagonalGaussian,
    SkeletonPrior,
)


class FGcnVae(CharacterVae):
    """F-GCN of one character.

    Parameters
    ----------
    skeleton : Skeleton
    hidden : 256 in the paper
    first : whether the condition is the character's skeleton in 20 channels, as the first's, or its
        partner in 16
    """

    def __init__(self, skeleton: Skeleton, *, hidden: int, first: bool) -> None:
        super().__init__()
        self.output_layer, self.first, self.hidden = DisplacementOutput(), first, hidden
        adjacency = off_diagonal_adjacency(skeleton)
        condition = 20 if first else 16
        self.condition_linear = nn.Linear(4 if first else 6, condition)
        quarter, half = hidden // 4, hidden // 2
        self.encoder = _graph_convolutions(adjacency, (3, hidden // 8, quarter))
        self.conditioned_encoder = _graph_convolutions(adjacency, (quarter + condition, half))
        # Mean and log variance.
        self.posterior = nn.ModuleList(
            [GraphConvolution(adjacency, half, hidden) for _ in range(2)]
        )
        decoder = (hidden + condition, hidden, half, quarter, hidden // 8)
        self.decoder = _graph_convolutions(adjacency, decoder)
        self.last_convolution = GraphConvolution(adjacency, hidden // 8, 3)
        self.output_linear = nn.Linear(3, 3)

    def latent_shape(self, inputs: CharacterInputs) -> tuple[int, ...]:
        """Return the shape of one latent per frame and joint."""
        return (*inputs.template.shape[:3], self.hidden)

    def encode(
        self, motion: Tensor, inputs: CharacterInputs, random: torch.Generator | None
    ) -> DiagonalGaussian:
        """Encode each frame's displacements."""
        del random  # there is no dropout
        x = _apply_with_relu(self.encoder, frames_first(inputs.displacements(motion)))
        x = torch.cat([x, frames_first(self._condition(inputs))], dim=-1)
        x = _apply_with_relu(self.conditioned_encoder, x)
        mean, log_variance = (batch_first(to_float32(layer(x))) for layer in self.posterior)
        return DiagonalGaussian(mean, log_variance.clamp(-10, 4))

    def decode(self, latent: Tensor, inputs: CharacterInputs) -> Tensor:
        """Decode the displacements of each frame."""
        x = frames_first(torch.cat([latent, self._condition(inputs)], dim=-1))
        x = self.last_convolution(_apply_with_relu(self.decoder, x))
        output: Tensor = self.output_linear(batch_first(to_float32(x)))
        return output * inputs.displacement_scale

    def _condition(self, inputs: CharacterInputs) -> Tensor:
        partner = torch.cat([inputs.partner, inputs.template], dim=-1)
        features = inputs.template_features if self.first else partner
        condition: Tensor = self.condition_linear(features)
        return condition


def _graph_convolutions(adjacency: Tensor, channels: tuple[int, ...]) -> nn.ModuleList:
    return nn.ModuleList([GraphConvolution(adjacency, a, b) for a, b in pairwise(channels)])


def _apply_with_relu(layers: nn.ModuleList, x: Tensor) -> Tensor:
    for layer in layers:
        x = layer(x).relu()
    return x


def build(config: PriorConfig) -> SkeletonPrior:
    """Build F-GCN for both characters."""
    first, second = (
        FGcnVae(config.skeleton, hidden=config.hidden, first=first) for first in (True, False)
    )
    return SkeletonPrior(config, (first, second), symmetric=False)
