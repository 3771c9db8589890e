"""The paper's form, layer by layer (supplement, tables 11 to 16): offsets, one body's scale.

Where the tables need settling: two heads make the Gaussian that one dense layer cannot; the 8
channels into ST-GCN3 are partner 3, own template 3 and both scales; its 16 channels go into
G-GRU2 whole, so that this has 25 inputs where table 16 says 10. Offsets are in the unit of the
data's changes.
"""

import torch
from torch import Tensor, nn

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.skeleton_prior.kinematics import DisplacementOutput
from pacmo_core.skeleton_prior.layers import (
    GraphGru,
    OutputHead,
    StGcnEncoder,
    adjacency,
    encoder_channels,
    end_poses,
    off_diagonal_adjacency,
    scale_offsets,
)
from pacmo_core.skeleton_prior.settings import PriorConfig
from pacmo_core.skeleton_prior.vae import (
    CharacterInputs,
    CharacterVae,
    DiagonalGaussian,
    GaussianHead,
    SkeletonPrior,
)

# Channels of the partner's code.
PARTNER_CHANNELS = 16


class AutoregressiveDecoder(nn.Module):
    """G-GRU1 and G-GRU2: each frame's offset goes into the next frame's step.

    Parameters
    ----------
    skeleton : Skeleton
    constant : channels of what is told in every frame alike
    hidden : int
    """

    def __init__(self, skeleton: Skeleton, constant: int, hidden: int) -> None:
        super().__init__()
        self.recurrent = GraphGru(adjacency(skeleton), constant + 3, hidden)
        self.head = OutputHead(hidden, 3)

    def forward(self, constant: Tensor, latent: Tensor, n_frames: int) -> Tensor:
        """Run freely from a latent ``(B, J, h)``: ``(B, J, C)`` to ``(B, T, J, 3)``."""
        gates, weights = self.recurrent.gates_in, self.recurrent.weights()
        told, heard = gates.weight[:, :-3], gates.weight[:, -3:]
        # What does not change is projected once; of each step's input the offset alone is new.
        given = nn.functional.linear(constant.transpose(0, 1), told, gates.bias)
        state, offset = latent.transpose(0, 1), given.new_zeros(*given.shape[:2], 3)
        offsets = []
        for _ in range(n_frames):
            state = self.recurrent.step(weights, given + offset @ heard.T, state)
            offset = self.head(state)
            offsets.append(offset)
        return torch.stack(offsets).permute(2, 0, 1, 3)


class PaperFirstVae(CharacterVae):
    """VAE2: ST-GCN1 and G-GRU1.

    Parameters
    ----------
    skeleton : Skeleton
    hidden : 256 in the paper's size
    dropout : share
    """

    def __init__(self, skeleton: Skeleton, *, hidden: int, dropout: float) -> None:
        super().__init__()
        self.hidden, self.place = hidden, DisplacementOutput()
        self.encoder = StGcnEncoder(
            off_diagonal_adjacency(skeleton), 4, encoder_channels(hidden), dropout=dropout
        )
        self.code = GaussianHead(hidden + 6, hidden)
        self.decoder = AutoregressiveDecoder(skeleton, 7, hidden)

    def latent_shape(self, given: CharacterInputs) -> tuple[int, ...]:
        """One code a joint."""
        rows, _, joints, _ = given.template.shape
        return (rows, joints, self.hidden)

    def encode(
        self, motion: Tensor, given: CharacterInputs, random: torch.Generator | None
    ) -> DiagonalGaussian:
        """Encode the offsets and the body (table 11)."""
        offsets = motion - given.template
        grown = scale_offsets(given.scales, motion.shape[1])
        encoded = self.encoder(torch.cat([offsets / given.unit, grown], dim=-1), random)
        code: DiagonalGaussian = self.code(torch.cat([encoded, end_poses(given.template)], dim=-1))
        return code

    def decode(self, latent: Tensor, given: CharacterInputs) -> Tensor:
        """Decode from the body and both ends of the template (table 12)."""
        constant = torch.cat([(given.scales - 1)[..., None], end_poses(given.template)], dim=-1)
        field: Tensor = self.decoder(constant, latent, given.template.shape[1])
        return field * given.unit


class PaperSecondVae(CharacterVae):
    """VAE3: ST-GCN2 and ST-GCN3, fused, and G-GRU2.

    Parameters
    ----------
    skeleton : Skeleton
    hidden : 256 in the paper's size
    dropout : share
    """

    def __init__(self, skeleton: Skeleton, *, hidden: int, dropout: float) -> None:
        super().__init__()
        self.hidden, self.place = hidden, DisplacementOutput()
        links = off_diagonal_adjacency(skeleton)
        self.encoder = StGcnEncoder(links, 3, encoder_channels(hidden), dropout=dropout)
        self.partner = StGcnEncoder(links, 8, (PARTNER_CHANNELS,) * 5, dropout=dropout)
        self.fusion = nn.Linear(hidden + PARTNER_CHANNELS + 6, hidden)
        self.code = GaussianHead(hidden, hidden)
        self.decoder = AutoregressiveDecoder(skeleton, PARTNER_CHANNELS + 6, hidden)

    def latent_shape(self, given: CharacterInputs) -> tuple[int, ...]:
        """One code a joint."""
        rows, _, joints, _ = given.template.shape
        return (rows, joints, self.hidden)

    def encode(
        self, motion: Tensor, given: CharacterInputs, random: torch.Generator | None
    ) -> DiagonalGaussian:
        """Encode the offsets and the partner (tables 13 to 15)."""
        offsets = self.encoder((motion - given.template) / given.unit, random)
        partner = self.partner(partner_features(given), random)
        fused = self.fusion(torch.cat([offsets, partner, end_poses(given.template)], dim=-1))
        code: DiagonalGaussian = self.code(fused.relu())
        return code

    def decode(self, latent: Tensor, given: CharacterInputs) -> Tensor:
        """Decode from the partner's code and both ends of the template (table 16)."""
        constant = torch.cat(
            [self.partner(partner_features(given), None), end_poses(given.template)], dim=-1
        )
        field: Tensor = self.decoder(constant, latent, given.template.shape[1])
        return field * given.unit


def partner_features(given: CharacterInputs) -> Tensor:
    """``(B, T, J, 8)``: the partner, the own template and both bodies."""
    n_frames = given.template.shape[1]
    return torch.cat(
        [
            given.partner,
            given.template,
            scale_offsets(given.partner_scales, n_frames),
            scale_offsets(given.scales, n_frames),
        ],
        dim=-1,
    )


def build(config: PriorConfig) -> SkeletonPrior:
    """Build the paper's model."""
    first = PaperFirstVae(config.skeleton, hidden=config.hidden, dropout=config.dropout)
    second = PaperSecondVae(config.skeleton, hidden=config.hidden, dropout=config.dropout)
    return SkeletonPrior(config, (first, second), both_roles=False)
