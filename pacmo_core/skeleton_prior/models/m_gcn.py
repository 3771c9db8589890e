"""M-GCN: ST-GCN layers over whole motions (supplement, table 20)."""

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
    scale_offsets,
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
    """M-GCN of a character: the encoder's ST-GCN layers without strides, and their mirror.

    Unlike table 20 the last layer of the first character's has no ReLU: an offset has either sign.

    Parameters
    ----------
    skeleton : Skeleton
    hidden : 256 in the paper's size, in which no layer here is wider than 128
    dropout : share, of the encoder
    first : whether it is told its body, or its partner
    """

    def __init__(self, skeleton: Skeleton, *, hidden: int, dropout: float, first: bool) -> None:
        super().__init__()
        self.place, self.first, self.width = DisplacementOutput(), first, hidden // 2
        links = off_diagonal_adjacency(skeleton)
        wide, half, quarter = hidden // 2, hidden // 4, hidden // 8
        told = 1 if first else PARTNER_CHANNELS
        self.telling = nn.Identity() if first else nn.Linear(6, PARTNER_CHANNELS)
        into = (4 if first else 3, quarter, half, wide)
        self.encoder = _st_gcn_stack(links, into, dropout, first=True)
        self.code = GaussianHead(wide + (0 if first else told), wide)
        out = (wide + told, wide, half, quarter, *((hidden // 16, 3) if first else ()))
        self.decoder = _st_gcn_stack(links, out, 0.0, first=False, active=not first)
        self.out = nn.Identity() if first else nn.Linear(quarter, 3)

    def latent_shape(self, given: CharacterInputs) -> tuple[int, ...]:
        """One code a frame and joint."""
        return (*given.template.shape[:3], self.width)

    def encode(
        self, motion: Tensor, given: CharacterInputs, random: torch.Generator | None
    ) -> DiagonalGaussian:
        """Encode the offsets with the body, or with the partner."""
        x = (motion - given.template) / given.unit
        if self.first:
            x = torch.cat([x, self._told(given)], dim=-1)
        x = frames_first(x)
        for layer in self.encoder:
            x = layer(x, random)
        x = batch_first(to_float32(x))
        code: DiagonalGaussian = self.code(
            x if self.first else torch.cat([x, self._told(given)], dim=-1)
        )
        return code

    def decode(self, latent: Tensor, given: CharacterInputs) -> Tensor:
        """Decode the whole motion."""
        x = frames_first(torch.cat([latent, self._told(given)], dim=-1))
        for layer in self.decoder:
            x = layer(x, None)
        field: Tensor = self.out(batch_first(to_float32(x)))
        return field * given.unit

    def _told(self, given: CharacterInputs) -> Tensor:
        if self.first:
            return scale_offsets(given.scales, given.template.shape[1])
        told: Tensor = self.telling(torch.cat([given.partner, given.template], dim=-1))
        return told


def _st_gcn_stack(
    links: Tensor,
    channels: tuple[int, ...],
    dropout: float,
    *,
    first: bool,
    active: bool = True,
) -> nn.ModuleList:
    layers = [
        StGcnLayer(links, a, b, stride=1, dropout=dropout, residual=not (first and number == 0))
        for number, (a, b) in enumerate(pairwise(channels))
    ]
    layers[-1].active = active
    return nn.ModuleList(layers)


def build(config: PriorConfig) -> SkeletonPrior:
    """Build M-GCN for both characters."""
    first, second = (
        MGcnVae(config.skeleton, hidden=config.hidden, dropout=config.dropout, first=first)
        for first in (True, False)
    )
    return SkeletonPrior(config, (first, second), both_roles=False)
