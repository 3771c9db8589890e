"""The paper's form, layer by layer (supplement, tables 11 to 16): offsets, one body's scale.

Where the tables need settling: two heads make the Gaussian that one dense layer cannot; the 8
channels into ST-GCN3 are partner 3, own template 3 and both scales; its 16 channels go into
G-GRU2 whole, so that this has 25 inputs where table 16 says 10. Offsets are in the unit of the
data's changes.
"""

import torch
from torch import Tensor, nn

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.skeleton_prior.character import Character, Code, Gaussian, Given
from pacmo_core.skeleton_prior.encoders import MotionEncoder, ends, everywhere, widths
from pacmo_core.skeleton_prior.graph import adjacency, neighbours
from pacmo_core.skeleton_prior.layers import Head
from pacmo_core.skeleton_prior.placing import Offsets
from pacmo_core.skeleton_prior.recurrence import GraphGru

# Channels of the partner's code.
PARTNER = 16


class FedBack(nn.Module):
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
        self.head = Head(hidden, 3)

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


class First(Character):
    """VAE2: ST-GCN1 and G-GRU1.

    Parameters
    ----------
    skeleton : Skeleton
    hidden : 256 in the paper's size
    dropout : share
    """

    def __init__(self, skeleton: Skeleton, *, hidden: int, dropout: float) -> None:
        super().__init__()
        self.hidden, self.place = hidden, Offsets()
        self.encoder = MotionEncoder(neighbours(skeleton), 4, widths(hidden), dropout=dropout)
        self.code = Gaussian(hidden + 6, hidden)
        self.decoder = FedBack(skeleton, 7, hidden)

    def latent_shape(self, given: Given) -> tuple[int, ...]:
        """One code a joint."""
        rows, _, joints, _ = given.template.shape
        return (rows, joints, self.hidden)

    def encode(self, motion: Tensor, given: Given, random: torch.Generator | None) -> Code:
        """Encode the offsets and the body (table 11)."""
        offsets = motion - given.template
        grown = everywhere(given.scales, motion.shape[1])
        encoded = self.encoder(torch.cat([offsets / given.unit, grown], dim=-1), random)
        code: Code = self.code(torch.cat([encoded, ends(given.template)], dim=-1))
        return code

    def decode(self, latent: Tensor, given: Given) -> Tensor:
        """Decode from the body and both ends of the template (table 12)."""
        constant = torch.cat([(given.scales - 1)[..., None], ends(given.template)], dim=-1)
        field: Tensor = self.decoder(constant, latent, given.template.shape[1])
        return field * given.unit


class Second(Character):
    """VAE3: ST-GCN2 and ST-GCN3, fused, and G-GRU2.

    Parameters
    ----------
    skeleton : Skeleton
    hidden : 256 in the paper's size
    dropout : share
    """

    def __init__(self, skeleton: Skeleton, *, hidden: int, dropout: float) -> None:
        super().__init__()
        self.hidden, self.place = hidden, Offsets()
        links = neighbours(skeleton)
        self.encoder = MotionEncoder(links, 3, widths(hidden), dropout=dropout)
        self.partner = MotionEncoder(links, 8, (PARTNER,) * 5, dropout=dropout)
        self.fusion = nn.Linear(hidden + PARTNER + 6, hidden)
        self.code = Gaussian(hidden, hidden)
        self.decoder = FedBack(skeleton, PARTNER + 6, hidden)

    def latent_shape(self, given: Given) -> tuple[int, ...]:
        """One code a joint."""
        rows, _, joints, _ = given.template.shape
        return (rows, joints, self.hidden)

    def encode(self, motion: Tensor, given: Given, random: torch.Generator | None) -> Code:
        """Encode the offsets and the partner (tables 13 to 15)."""
        offsets = self.encoder((motion - given.template) / given.unit, random)
        partner = self.partner(beside(given), random)
        fused = self.fusion(torch.cat([offsets, partner, ends(given.template)], dim=-1))
        code: Code = self.code(fused.relu())
        return code

    def decode(self, latent: Tensor, given: Given) -> Tensor:
        """Decode from the partner's code and both ends of the template (table 16)."""
        constant = torch.cat([self.partner(beside(given), None), ends(given.template)], dim=-1)
        field: Tensor = self.decoder(constant, latent, given.template.shape[1])
        return field * given.unit


def beside(given: Given) -> Tensor:
    """``(B, T, J, 8)``: the partner, the own template and both bodies."""
    n_frames = given.template.shape[1]
    return torch.cat(
        [
            given.partner,
            given.template,
            everywhere(given.partner_scales, n_frames),
            everywhere(given.scales, n_frames),
        ],
        dim=-1,
    )
