"""The paper's model, layer by layer (supplement, tables 11 to 16): displacements and one skeleton.

Where the tables are inconsistent or incomplete: a dense layer that yields the latent has two
outputs, mean and log variance; the 8 input channels of ST-GCN3 are the partner 3, the template 3
and both characters' scales; its 16 output channels all enter G-GRU2, which so has 25 input channels
where table 16 says 10. Displacements are normalised by their root mean square in the training data.
"""

import torch
from torch import Tensor, nn

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.skeleton_prior.kinematics import DisplacementOutput
from pacmo_core.skeleton_prior.layers import (
    GraphGru,
    StGcnEncoder,
    encoder_channels,
    normalised_adjacency,
    off_diagonal_adjacency,
    output_head,
)
from pacmo_core.skeleton_prior.settings import PriorConfig
from pacmo_core.skeleton_prior.skeleton_vae import DiagonalGaussian
from pacmo_core.skeleton_prior.vae import CharacterInputs, CharacterVae, SkeletonPrior

# Output channels of ST-GCN3, the partner's encoder.
PARTNER_CHANNELS = 16


class AutoregressiveDecoder(nn.Module):
    """G-GRU1 and G-GRU2: the displacement of each frame is an input of the next step."""

    def __init__(self, skeleton: Skeleton, condition_channels: int, hidden: int) -> None:
        super().__init__()
        self.gru = GraphGru(normalised_adjacency(skeleton), condition_channels + 3, hidden)
        self.head = output_head(hidden, 3)

    def forward(self, condition: Tensor, state: Tensor, n_frames: int) -> Tensor:
        """Decode a condition (B, J, C) from the first state (B, J, h) to ``(B, T, J, 3)``."""
        displacements = [condition.new_zeros(*condition.shape[:2], 3)]
        adjacency = self.gru.adjacency()
        for _ in range(n_frames):
            inputs = self.gru.gates_in(torch.cat([condition, displacements[-1]], dim=-1))
            state = self.gru.step(adjacency, inputs, state)
            displacements.append(self.head(state))
        return torch.stack(displacements[1:], dim=1)


class PaperVae(CharacterVae):
    """VAE2 and VAE3, of the first and the second character.

    VAE2 has ST-GCN1 and G-GRU1 (tables 11 and 12); VAE3 has ST-GCN2 and ST-GCN3, of the own motion
    and of the partner, a layer that fuses them, and G-GRU2 (tables 13 to 16). In the paper
    ``hidden`` is 256.
    """

    def __init__(self, skeleton: Skeleton, *, hidden: int, first: bool) -> None:
        super().__init__()
        self.hidden, self.output_layer = hidden, DisplacementOutput()
        adjacency, channels = off_diagonal_adjacency(skeleton), encoder_channels(hidden)
        self.encoder = StGcnEncoder(adjacency, 4 if first else 3, channels)
        self.partner_encoder, self.fusion = None, nn.Sequential()
        n_encoded, n_condition = hidden + 6, 7
        if not first:
            self.partner_encoder = StGcnEncoder(adjacency, 8, (PARTNER_CHANNELS,) * 5)
            self.fusion = nn.Sequential(nn.Linear(n_encoded + PARTNER_CHANNELS, hidden), nn.ReLU())
            n_encoded, n_condition = hidden, PARTNER_CHANNELS + 6
        self.posterior = nn.Linear(n_encoded, 2 * hidden)
        self.decoder = AutoregressiveDecoder(skeleton, n_condition, hidden)

    def latent_shape(self, inputs: CharacterInputs) -> tuple[int, ...]:
        """Return the shape of one latent per joint."""
        rows, _, joints, _ = inputs.template.shape
        return (rows, joints, self.hidden)

    def encode(self, motion: Tensor, inputs: CharacterInputs) -> DiagonalGaussian:
        """Encode displacements, and the scales or the partner (tables 11; 13 to 15)."""
        x = inputs.displacements(motion)
        if self.partner_encoder is None:
            parts = [self.encoder(torch.cat([x, inputs.scale_offsets], dim=1))]
        else:
            parts = [self.encoder(x), self.partner_encoder(inputs.partner_features)]
        fused = self.fusion(torch.cat([*parts, inputs.end_poses], dim=-1))
        return DiagonalGaussian.from_output(self.posterior(fused))

    def decode(self, latent: Tensor, inputs: CharacterInputs) -> Tensor:
        """Decode from the scales or the partner, and the template's first and last pose."""
        if self.partner_encoder is None:
            condition = (inputs.scales - 1)[..., None]
        else:
            condition = self.partner_encoder(inputs.partner_features)
        condition = torch.cat([condition, inputs.end_poses], dim=-1)
        output: Tensor = self.decoder(condition, latent, inputs.template.shape[1])
        return output * inputs.displacement_scale


def build(config: PriorConfig) -> SkeletonPrior:
    """Build the paper's model."""
    first, second = (
        PaperVae(config.skeleton, hidden=config.hidden, first=first) for first in (True, False)
    )
    return SkeletonPrior(config, (first, second), symmetric=False)
