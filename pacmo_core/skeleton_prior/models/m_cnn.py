"""M-CNN and M-GCN: baselines that see whole motions at once (supplement, tables 19 and 20).

Their pooling keeps every frame and joint in the tables, so its stride is 1. What the tables call
encodings of the partner are dense layers here, but for the 8 channels that ST-GCN3 takes too.
"""

from itertools import pairwise

import torch
from torch import Tensor, nn

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.skeleton_prior.kinematics import DisplacementOutput
from pacmo_core.skeleton_prior.layers import (
    FrameJointConvolution,
    max_pool_frames,
    scale_offsets,
)
from pacmo_core.skeleton_prior.models.paper import partner_features
from pacmo_core.skeleton_prior.settings import PriorConfig
from pacmo_core.skeleton_prior.vae import (
    CharacterInputs,
    CharacterVae,
    DiagonalGaussian,
    SkeletonPrior,
)


class MCnnVae(CharacterVae):
    """M-CNN of a character: convolutions over frames and joints.

    Parameters
    ----------
    skeleton : Skeleton
    hidden : 256 in the paper's size, in which no layer here is wider than 64
    first : whether it is told its body, or its partner
    """

    def __init__(self, skeleton: Skeleton, *, hidden: int, first: bool) -> None:
        super().__init__()
        self.place, self.first, self.width = DisplacementOutput(), first, hidden // 4
        del skeleton
        wide, half, quarter = hidden // 4, hidden // 8, hidden // 16
        self.telling = nn.Identity() if first else nn.Linear(3, 8)
        down = (4, quarter, half) if first else (16, half)
        self.down = nn.ModuleList([FrameJointConvolution(a, b) for a, b in pairwise(down)])
        self.code = nn.ModuleList([FrameJointConvolution(half, wide) for _ in range(2)])
        self.lifting = nn.Linear(wide + (1 if first else 8), wide)
        up = (wide, half, quarter, 3) if first else (wide, half, quarter)
        self.up = nn.ModuleList([FrameJointConvolution(a, b) for a, b in pairwise(up)])
        self.out = nn.Linear(up[-1], 3)

    def latent_shape(self, given: CharacterInputs) -> tuple[int, ...]:
        """One code a frame and joint."""
        return (*given.template.shape[:3], self.width)

    def encode(
        self, motion: Tensor, given: CharacterInputs, random: torch.Generator | None
    ) -> DiagonalGaussian:
        """Encode the offsets with the body, or with the partner."""
        del random  # nothing is dropped
        offsets = (motion - given.template) / given.unit
        x = torch.cat([self.telling(offsets), self._told(given)], dim=-1)
        for layer in self.down:
            x = max_pool_frames(layer(x).relu())
        mean, log_variance = self.code
        return DiagonalGaussian(mean(x), log_variance(x).clamp(-10, 4))

    def decode(self, latent: Tensor, given: CharacterInputs) -> Tensor:
        """Decode the whole motion."""
        x = self.lifting(torch.cat([latent, self._told(given)], dim=-1)).relu()
        for number, layer in enumerate(self.up, start=1):
            # What has three channels is an offset, of either sign.
            x = layer(x) if self.first and number == len(self.up) else layer(x).relu()
        field: Tensor = self.out(x)
        return field * given.unit

    def _told(self, given: CharacterInputs) -> Tensor:
        return (
            scale_offsets(given.scales, given.template.shape[1])
            if self.first
            else partner_features(given)
        )


def build(config: PriorConfig) -> SkeletonPrior:
    """Build M-CNN for both characters."""
    first, second = (
        MCnnVae(config.skeleton, hidden=config.hidden, first=first) for first in (True, False)
    )
    return SkeletonPrior(config, (first, second), both_roles=False)
