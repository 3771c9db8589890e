"""M-GCN: a baseline of ST-GCN layers without strides over a whole motion (supplement, table 20)."""

from itertools import pairwise

import torch
from torch import Tensor, nn

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.skeleton_prior.autograd_functions import to_float32
from pacmo_core.skeleton_prior.kinematics import DisplacementOutput
from pacmo_core.skeleton_prior.layers import (
    StGcnLayer,
    batch_first,
    frames_first,
    off_diagonal_adjacency,
)
from pacmo_core.skeleton_prior.models.paper import PARTNER_CHANNELS
from pacmo_core.skeleton_prior.settings import PriorConfig
from pacmo_core.skeleton_prior.vae import (
    CharacterInputs,
    CharacterVae,
    DiagonalGaussian,
    GaussianHead,
    SkeletonPrior,
)


class MGcnVae(CharacterVae):
    """M-GCN of one character.

    Unlike in table 20, the last layer of the first character's decoder has no ReLU: displacements
    are of either sign.

    Parameters
    ----------
    skeleton : Skeleton
    hidden : 256 in the paper, where no layer of this model is wider than 128
    dropout : probability, in the encoder
    first : whether the condition is the character's skeleton, as the first's, or its partner
    """

    def __init__(self, skeleton: Skeleton, *, hidden: int, dropout: float, first: bool) -> None:
        super().__init__()
        self.output_layer, self.first, self.width = DisplacementOutput(), first, hidden // 2
        adjacency = off_diagonal_adjacency(skeleton)
        wide, half, quarter = hidden // 2, hidden // 4, hidden // 8
        condition = 1 if first else PARTNER_CHANNELS
        self.condition_linear = nn.Identity() if first else nn.Linear(6, PARTNER_CHANNELS)
        encoder = (4 if first else 3, quarter, half, wide)
        self.encoder = _st_gcn_layers(
            adjacency, encoder, dropout, first_residual=False, final_relu=True
        )
        self.posterior = GaussianHead(wide + (0 if first else condition), wide)
        decoder = (wide + condition, wide, half, quarter, *((hidden // 16, 3) if first else ()))
        self.decoder = _st_gcn_layers(
            adjacency, decoder, 0.0, first_residual=True, final_relu=not first
        )
        self.output_linear = nn.Identity() if first else nn.Linear(quarter, 3)

    def latent_shape(self, inputs: CharacterInputs) -> tuple[int, ...]:
        """Return the shape of one latent per frame and joint."""
        return (*inputs.template.shape[:3], self.width)

    def encode(
        self, motion: Tensor, inputs: CharacterInputs, random: torch.Generator | None
    ) -> DiagonalGaussian:
        """Encode displacements and condition."""
        x = inputs.displacements(motion)
        if self.first:
            x = torch.cat([x, self._condition(inputs)], dim=-1)
        x = frames_first(x)
        for layer in self.encoder:
            x = layer(x, random)
        x = batch_first(to_float32(x))
        if not self.first:
            x = torch.cat([x, self._condition(inputs)], dim=-1)
        posterior: DiagonalGaussian = self.posterior(x)
        return posterior

    def decode(self, latent: Tensor, inputs: CharacterInputs) -> Tensor:
        """Decode the displacements of the whole motion."""
        x = frames_first(torch.cat([latent, self._condition(inputs)], dim=-1))
        for layer in self.decoder:
            x = layer(x, None)
        output: Tensor = self.output_linear(batch_first(to_float32(x)))
        return output * inputs.displacement_scale

    def _condition(self, inputs: CharacterInputs) -> Tensor:
        if self.first:
            return inputs.scale_offsets
        partner = torch.cat([inputs.partner, inputs.template], dim=-1)
        condition: Tensor = self.condition_linear(partner)
        return condition


def _st_gcn_layers(
    adjacency: Tensor,
    channels: tuple[int, ...],
    dropout: float,
    *,
    first_residual: bool,
    final_relu: bool,
) -> nn.ModuleList:
    layers = [
        StGcnLayer(
            adjacency, a, b, stride=1, dropout=dropout, residual=number > 0 or first_residual
        )
        for number, (a, b) in enumerate(pairwise(channels))
    ]
    layers[-1].final_relu = final_relu
    return nn.ModuleList(layers)


def build(config: PriorConfig) -> SkeletonPrior:
    """Build M-GCN for both characters."""
    first, second = (
        MGcnVae(config.skeleton, hidden=config.hidden, dropout=config.dropout, first=first)
        for first in (True, False)
    )
    return SkeletonPrior(config, (first, second), symmetric=False)
