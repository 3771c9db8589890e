"""F-CNN and F-GCN: baselines that see one frame at a time (supplement, tables 17 and 18).

The tables halve the joints and leave open how an odd number is halved: here with the larger half,
25 to 13, 7 and 4, and up again by transposed convolutions of kernel 3, stride 2 and padding 1,
which go back exactly. What is joined at an eighth of the joints is averaged over the same joints.
"""

import torch
from torch import Tensor, nn

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.skeleton_prior.kinematics import DisplacementOutput
from pacmo_core.skeleton_prior.layers import (
    JointConvolution,
    JointTransposedConvolution,
    pool_joint_pairs,
    scale_offsets,
)
from pacmo_core.skeleton_prior.models.paper import partner_features
from pacmo_core.skeleton_prior.settings import PriorConfig
from pacmo_core.skeleton_prior.vae import (
    CharacterInputs,
    CharacterVae,
    DiagonalGaussian,
    GaussianHead,
    SkeletonPrior,
)


class FCnnVae(CharacterVae):
    """F-CNN of a character: convolutions along the joints in their order.

    Parameters
    ----------
    skeleton : Skeleton
    hidden : 256 in the paper's size
    first : whether it is told its body, or its partner
    """

    def __init__(self, skeleton: Skeleton, *, hidden: int, first: bool) -> None:
        super().__init__()
        self.place, self.first, self.hidden = DisplacementOutput(), first, hidden
        sizes = [len(skeleton.joints)]
        for _ in range(3):
            sizes.append((sizes[-1] + 1) // 2)
        self.sizes = sizes
        down = (hidden // 8, hidden // 4, hidden // 2, hidden)
        # The first character's decoder is not the encoder's mirror; the tables have it so.
        up = (
            (hidden, hidden // 2, hidden // 8) if first else (hidden // 2, hidden // 4, hidden // 8)
        )
        told = 4 if first else 8
        self.down = nn.ModuleList(
            [JointConvolution(a, b) for a, b in zip((3, *down), down, strict=False)]
        )
        self.code = GaussianHead(hidden + told, hidden)
        self.lifting = nn.Linear(hidden + told, hidden)
        self.up = nn.ModuleList(
            [JointTransposedConvolution(a, b) for a, b in zip((hidden, *up), up, strict=False)]
        )
        self.out = nn.Linear(up[-1], 3)

    def latent_shape(self, given: CharacterInputs) -> tuple[int, ...]:
        """One code a frame and eighth of the joints."""
        return (*given.template.shape[:2], self.sizes[-1], self.hidden)

    def encode(
        self, motion: Tensor, given: CharacterInputs, random: torch.Generator | None
    ) -> DiagonalGaussian:
        """Encode each frame's offsets."""
        del random  # nothing is dropped
        x = self.down[0]((motion - given.template) / given.unit)
        for layer in self.down[1:]:
            x = pool_joint_pairs(layer(x), most=True)
        code: DiagonalGaussian = self.code(torch.cat([x, self._told(given)], dim=-1))
        return code

    def decode(self, latent: Tensor, given: CharacterInputs) -> Tensor:
        """Decode each frame."""
        x = self.lifting(torch.cat([latent, self._told(given)], dim=-1)).relu()
        for layer, size in zip(self.up, self.sizes[2::-1], strict=True):
            x = layer(x, size)
        field: Tensor = self.out(x)
        return field * given.unit

    def _told(self, given: CharacterInputs) -> Tensor:
        told = template_features(given) if self.first else partner_features(given)
        for _ in range(3):
            told = pool_joint_pairs(told, most=False)
        return told


def template_features(given: CharacterInputs) -> Tensor:
    """``(B, T, J, 4)``: the own template and the own body."""
    grown = scale_offsets(given.scales, given.template.shape[1])
    return torch.cat([given.template, grown], dim=-1)


def build(config: PriorConfig) -> SkeletonPrior:
    """Build F-CNN for both characters."""
    first, second = (
        FCnnVae(config.skeleton, hidden=config.hidden, first=first) for first in (True, False)
    )
    return SkeletonPrior(config, (first, second), both_roles=False)
