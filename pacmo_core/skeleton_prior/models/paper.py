"""The paper's model, layer by layer (supplement, tables 11 to 16): displacements and one skeleton.

Where the tables are inconsistent or incomplete: a dense layer that yields the latent becomes two
heads, of mean and log variance; the 8 input channels of ST-GCN3 are the partner 3, the template 3
and both characters' scales; its 16 output channels all enter G-GRU2, which so has 25 input channels
where table 16 says 10. Displacements are normalised by their root mean square in the training data.
"""

import torch
from torch import Tensor, nn

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.skeleton_prior.kinematics import DisplacementOutput
from pacmo_core.skeleton_prior.layers import (
    GraphGru,
    OutputHead,
    StGcnEncoder,
    encoder_channels,
    normalised_adjacency,
    off_diagonal_adjacency,
)
from pacmo_core.skeleton_prior.settings import PriorConfig
from pacmo_core.skeleton_prior.vae import (
    CharacterInputs,
    CharacterVae,
    DiagonalGaussian,
    GaussianHead,
    SkeletonPrior,
)

# Output channels of ST-GCN3, the partner's encoder.
PARTNER_CHANNELS = 16


class AutoregressiveDecoder(nn.Module):
    """G-GRU1 and G-GRU2: the displacement of each frame is an input of the next step.

    Parameters
    ----------
    skeleton : Skeleton
    condition_channels : of the inputs that are constant over time
    hidden : int
    """

    def __init__(self, skeleton: Skeleton, condition_channels: int, hidden: int) -> None:
        super().__init__()
        self.gru = GraphGru(normalised_adjacency(skeleton), condition_channels + 3, hidden)
        self.head = OutputHead(hidden, 3)

    def forward(self, condition: Tensor, latent: Tensor, n_frames: int) -> Tensor:
        """Decode from the initial state ``(B, J, h)``: ``(B, J, C)`` to ``(B, T, J, 3)``."""
        gates, weights = self.gru.gates_in, self.gru.folded_weights()
        condition_weight, displacement_weight = gates.weight[:, :-3], gates.weight[:, -3:]
        # The constant inputs are projected once, not in every step.
        projected = nn.functional.linear(condition.transpose(0, 1), condition_weight, gates.bias)
        state = latent.transpose(0, 1)
        displacement = projected.new_zeros(*projected.shape[:2], 3)
        displacements = []
        for _ in range(n_frames):
            inputs = projected + displacement @ displacement_weight.T
            state = self.gru.step(weights, inputs, state)
            displacement = self.head(state)
            displacements.append(displacement)
        return torch.stack(displacements).permute(2, 0, 1, 3)


class PaperFirstVae(CharacterVae):
    """VAE2, of the first character: ST-GCN1 and G-GRU1.

    Parameters
    ----------
    skeleton : Skeleton
    hidden : 256 in the paper
    dropout : probability
    """

    def __init__(self, skeleton: Skeleton, *, hidden: int, dropout: float) -> None:
        super().__init__()
        self.hidden, self.output_layer = hidden, DisplacementOutput()
        self.encoder = StGcnEncoder(
            off_diagonal_adjacency(skeleton), 4, encoder_channels(hidden), dropout=dropout
        )
        self.posterior = GaussianHead(hidden + 6, hidden)
        self.decoder = AutoregressiveDecoder(skeleton, 7, hidden)

    def latent_shape(self, inputs: CharacterInputs) -> tuple[int, ...]:
        """Return the shape of one latent per joint."""
        rows, _, joints, _ = inputs.template.shape
        return (rows, joints, self.hidden)

    def encode(
        self, motion: Tensor, inputs: CharacterInputs, random: torch.Generator | None
    ) -> DiagonalGaussian:
        """Encode displacements and scales (table 11)."""
        x = torch.cat([inputs.displacements(motion), inputs.scale_offsets], dim=-1)
        encoded = self.encoder(x, random)
        posterior: DiagonalGaussian = self.posterior(torch.cat([encoded, inputs.end_poses], dim=-1))
        return posterior

    def decode(self, latent: Tensor, inputs: CharacterInputs) -> Tensor:
        """Decode from the scales and the first and last pose of the template (table 12)."""
        condition = torch.cat([(inputs.scales - 1)[..., None], inputs.end_poses], dim=-1)
        output: Tensor = self.decoder(condition, latent, inputs.template.shape[1])
        return output * inputs.displacement_scale


class PaperSecondVae(CharacterVae):
    """VAE3, of the second character: ST-GCN2 and ST-GCN3, fused, and G-GRU2.

    Parameters
    ----------
    skeleton : Skeleton
    hidden : 256 in the paper
    dropout : probability
    """

    def __init__(self, skeleton: Skeleton, *, hidden: int, dropout: float) -> None:
        super().__init__()
        self.hidden, self.output_layer = hidden, DisplacementOutput()
        adjacency = off_diagonal_adjacency(skeleton)
        self.encoder = StGcnEncoder(adjacency, 3, encoder_channels(hidden), dropout=dropout)
        self.partner_encoder = StGcnEncoder(adjacency, 8, (PARTNER_CHANNELS,) * 5, dropout=dropout)
        self.fusion = nn.Linear(hidden + PARTNER_CHANNELS + 6, hidden)
        self.posterior = GaussianHead(hidden, hidden)
        self.decoder = AutoregressiveDecoder(skeleton, PARTNER_CHANNELS + 6, hidden)

    def latent_shape(self, inputs: CharacterInputs) -> tuple[int, ...]:
        """Return the shape of one latent per joint."""
        rows, _, joints, _ = inputs.template.shape
        return (rows, joints, self.hidden)

    def encode(
        self, motion: Tensor, inputs: CharacterInputs, random: torch.Generator | None
    ) -> DiagonalGaussian:
        """Encode displacements and partner (tables 13 to 15)."""
        encoded = self.encoder(inputs.displacements(motion), random)
        partner = self.partner_encoder(inputs.partner_features, random)
        fused = self.fusion(torch.cat([encoded, partner, inputs.end_poses], dim=-1))
        posterior: DiagonalGaussian = self.posterior(fused.relu())
        return posterior

    def decode(self, latent: Tensor, inputs: CharacterInputs) -> Tensor:
        """Decode from the partner and the first and last pose of the template (table 16)."""
        partner = self.partner_encoder(inputs.partner_features, None)
        condition = torch.cat([partner, inputs.end_poses], dim=-1)
        output: Tensor = self.decoder(condition, latent, inputs.template.shape[1])
        return output * inputs.displacement_scale


def build(config: PriorConfig) -> SkeletonPrior:
    """Build the paper's model."""
    first = PaperFirstVae(config.skeleton, hidden=config.hidden, dropout=config.dropout)
    second = PaperSecondVae(config.skeleton, hidden=config.hidden, dropout=config.dropout)
    return SkeletonPrior(config, (first, second), symmetric=False)
