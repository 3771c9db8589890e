"""F-CNN: a baseline of convolutions over the joints of one frame (supplement, table 17).

The table halves the number of joints and does not define how odd numbers are halved. Here pooling
rounds up, 25 to 13, 7 and 4, and transposed convolutions of kernel 3, stride 2 and padding 1 invert
it exactly. Conditions joined at an eighth of the joints are averaged over the same joints.
"""

from itertools import pairwise

import torch
from torch import Tensor, nn

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.skeleton_prior.kinematics import DisplacementOutput
from pacmo_core.skeleton_prior.layers import (
    JointConvolution,
    JointTransposedConvolution,
    max_pool_joints,
    mean_pool_joints,
)
from pacmo_core.skeleton_prior.settings import PriorConfig
from pacmo_core.skeleton_prior.vae import (
    CharacterInputs,
    CharacterVae,
    DiagonalGaussian,
    GaussianHead,
    SkeletonPrior,
)


class FCnnVae(CharacterVae):
    """F-CNN of one character.

    Parameters
    ----------
    skeleton : Skeleton
    hidden : 256 in the paper
    first : whether the condition is the character's skeleton, as the first's, or its partner
    """

    def __init__(self, skeleton: Skeleton, *, hidden: int, first: bool) -> None:
        super().__init__()
        self.output_layer, self.first, self.hidden = DisplacementOutput(), first, hidden
        sizes = [len(skeleton.joints)]
        for _ in range(3):
            sizes.append((sizes[-1] + 1) // 2)
        self.sizes = sizes
        down = (3, hidden // 8, hidden // 4, hidden // 2, hidden)
        # The first character's decoder does not mirror its encoder, in the table too.
        up = (
            (hidden, hidden, hidden // 2, hidden // 8)
            if first
            else (hidden, hidden // 2, hidden // 4, hidden // 8)
        )
        condition = 4 if first else 8
        self.encoder = nn.ModuleList([JointConvolution(a, b) for a, b in pairwise(down)])
        self.posterior = GaussianHead(hidden + condition, hidden)
        self.decoder_linear = nn.Linear(hidden + condition, hidden)
        self.decoder = nn.ModuleList([JointTransposedConvolution(a, b) for a, b in pairwise(up)])
        self.output_linear = nn.Linear(up[-1], 3)

    def latent_shape(self, inputs: CharacterInputs) -> tuple[int, ...]:
        """Return the shape of one latent per frame and eighth of the joints."""
        return (*inputs.template.shape[:2], self.sizes[-1], self.hidden)

    def encode(
        self, motion: Tensor, inputs: CharacterInputs, random: torch.Generator | None
    ) -> DiagonalGaussian:
        """Encode each frame's displacements."""
        del random  # there is no dropout
        x = self.encoder[0](inputs.displacements(motion))
        for layer in self.encoder[1:]:
            x = max_pool_joints(layer(x))
        x = torch.cat([x, self._condition(inputs)], dim=-1)
        posterior: DiagonalGaussian = self.posterior(x)
        return posterior

    def decode(self, latent: Tensor, inputs: CharacterInputs) -> Tensor:
        """Decode the displacements of each frame."""
        x = self.decoder_linear(torch.cat([latent, self._condition(inputs)], dim=-1)).relu()
        for layer, size in zip(self.decoder, self.sizes[2::-1], strict=True):
            x = layer(x, size)
        output: Tensor = self.output_linear(x)
        return output * inputs.displacement_scale

    def _condition(self, inputs: CharacterInputs) -> Tensor:
        condition = inputs.template_features if self.first else inputs.partner_features
        for _ in range(3):
            condition = mean_pool_joints(condition)
        return condition


def build(config: PriorConfig) -> SkeletonPrior:
    """Build F-CNN for both characters."""
    first, second = (
        FCnnVae(config.skeleton, hidden=config.hidden, first=first) for first in (True, False)
    )
    return SkeletonPrior(config, (first, second), symmetric=False)
