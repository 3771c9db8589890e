"""M-CNN: a baseline of convolutions over the frames and joints of a motion (supplement, table 19).

Its max-pooling keeps every frame and joint in the table, so its stride is 1. The 8 channels of the
second character's condition are those of ST-GCN3.
"""

from itertools import pairwise

import torch
from torch import Tensor, nn

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.skeleton_prior.kinematics import DisplacementOutput
from pacmo_core.skeleton_prior.layers import FrameJointConvolution, max_pool_frames
from pacmo_core.skeleton_prior.settings import PriorConfig
from pacmo_core.skeleton_prior.vae import (
    CharacterInputs,
    CharacterVae,
    DiagonalGaussian,
    SkeletonPrior,
)


class MCnnVae(CharacterVae):
    """M-CNN of one character.

    Parameters
    ----------
    skeleton : Skeleton
    hidden : 256 in the paper, where no layer of this model is wider than 64
    first : whether the condition is the character's skeleton, as the first's, or its partner
    """

    def __init__(self, skeleton: Skeleton, *, hidden: int, first: bool) -> None:
        super().__init__()
        self.output_layer, self.first, self.width = DisplacementOutput(), first, hidden // 4
        del skeleton  # the convolutions fit any number of joints
        wide, half, quarter = hidden // 4, hidden // 8, hidden // 16
        self.displacement_linear = nn.Identity() if first else nn.Linear(3, 8)
        encoder = (4, quarter, half) if first else (16, half)
        self.encoder = nn.ModuleList([FrameJointConvolution(a, b) for a, b in pairwise(encoder)])
        # Mean and log variance.
        self.posterior = nn.ModuleList([FrameJointConvolution(half, wide) for _ in range(2)])
        self.decoder_linear = nn.Linear(wide + (1 if first else 8), wide)
        decoder = (wide, half, quarter, 3) if first else (wide, half, quarter)
        self.decoder = nn.ModuleList([FrameJointConvolution(a, b) for a, b in pairwise(decoder)])
        self.output_linear = nn.Linear(decoder[-1], 3)

    def latent_shape(self, inputs: CharacterInputs) -> tuple[int, ...]:
        """Return the shape of one latent per frame and joint."""
        return (*inputs.template.shape[:3], self.width)

    def encode(
        self, motion: Tensor, inputs: CharacterInputs, random: torch.Generator | None
    ) -> DiagonalGaussian:
        """Encode displacements and condition."""
        del random  # there is no dropout
        displacements = self.displacement_linear(inputs.displacements(motion))
        x = torch.cat([displacements, self._condition(inputs)], dim=-1)
        for layer in self.encoder:
            x = max_pool_frames(layer(x).relu())
        mean, log_variance = self.posterior
        return DiagonalGaussian(mean(x), log_variance(x).clamp(-10, 4))

    def decode(self, latent: Tensor, inputs: CharacterInputs) -> Tensor:
        """Decode the displacements of the whole motion."""
        x = self.decoder_linear(torch.cat([latent, self._condition(inputs)], dim=-1)).relu()
        for number, layer in enumerate(self.decoder, start=1):
            # No ReLU on three channels: these are displacements, of either sign.
            x = layer(x) if self.first and number == len(self.decoder) else layer(x).relu()
        output: Tensor = self.output_linear(x)
        return output * inputs.displacement_scale

    def _condition(self, inputs: CharacterInputs) -> Tensor:
        return inputs.scale_offsets if self.first else inputs.partner_features


def build(config: PriorConfig) -> SkeletonPrior:
    """Build M-CNN for both characters."""
    first, second = (
        MCnnVae(config.skeleton, hidden=config.hidden, first=first) for first in (True, False)
    )
    return SkeletonPrior(config, (first, second), symmetric=False)
