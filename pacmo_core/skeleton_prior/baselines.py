"""The four baselines (supplement, tables 17 to 20): CNNs and GCNs, frame by frame or over motions.

F-CNN: the table halves the number of joints and does not define how odd numbers are halved. Here
pooling rounds up, 25 to 13, 7 and 4, and transposed convolutions invert it. Conditions joined at an
eighth of the joints are averaged over the same joints. M-CNN: its max-pooling keeps every frame and
joint in the table, so its stride is 1; the 8 channels of the second character's condition are those
of ST-GCN3. Where the last layer of a decoder would end in a ReLU, displacements of either sign need
none.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import torch
from torch import Tensor, nn

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.skeleton_prior.kinematics import DisplacementOutput
from pacmo_core.skeleton_prior.layers import (
    GraphConvolution,
    StGcnLayer,
    off_diagonal_adjacency,
)
from pacmo_core.skeleton_prior.paper import PARTNER_CHANNELS
from pacmo_core.skeleton_prior.settings import PriorConfig
from pacmo_core.skeleton_prior.skeleton_vae import DiagonalGaussian
from pacmo_core.skeleton_prior.vae import (
    CharacterInputs,
    CharacterVae,
    SkeletonPrior,
    channels_first,
)


@dataclass(frozen=True)
class Networks:
    """The networks of one baseline and character, on ``(B, C, T, J)``."""

    displacement_encoder: nn.Module  # of the displacements alone
    condition: nn.Module  # of the condition's features
    encoder: nn.Module  # of both side by side
    posterior: nn.Module  # to mean and log variance
    decoder: nn.Module  # of latent and condition to displacements
    latent: tuple[int, int]  # its channels and joints


class BaselineVae(CharacterVae):
    """A baseline of one character: a latent for each frame, decoded beside the condition."""

    def __init__(self, networks: Networks, features: Callable[[CharacterInputs], Tensor]) -> None:
        super().__init__()
        self.output_layer, self.features = DisplacementOutput(), features
        self.latent = networks.latent
        self.displacement_encoder, self.encoder = networks.displacement_encoder, networks.encoder
        self.condition, self.posterior = networks.condition, networks.posterior
        self.decoder = networks.decoder

    def latent_shape(self, inputs: CharacterInputs) -> tuple[int, ...]:
        """Return the shape of one latent per frame and joint, or per eighth of the joints."""
        channels, joints = self.latent
        return (len(inputs.template), channels, inputs.template.shape[1], joints)

    def encode(self, motion: Tensor, inputs: CharacterInputs) -> DiagonalGaussian:
        """Encode displacements and condition."""
        encoded = self.displacement_encoder(inputs.displacements(motion))
        encoded = self.encoder(self._with_condition(encoded, inputs))
        return DiagonalGaussian.from_output(self.posterior(encoded), dim=1)

    def decode(self, latent: Tensor, inputs: CharacterInputs) -> Tensor:
        """Decode displacements."""
        output: Tensor = self.decoder(self._with_condition(latent, inputs))
        return output.permute(0, 2, 3, 1) * inputs.displacement_scale

    def _with_condition(self, x: Tensor, inputs: CharacterInputs) -> Tensor:
        return torch.cat([x, self.condition(self.features(inputs))], dim=1)


def partner_positions(inputs: CharacterInputs) -> Tensor:
    """``(B, 6, T, J)``: the partner 3 and the template 3."""
    return torch.cat([channels_first(inputs.partner), channels_first(inputs.template)], dim=1)


def dense(into: int, out: int) -> nn.Conv2d:
    """Build a linear layer on the channels."""
    return nn.Conv2d(into, out, 1)


def f_cnn(skeleton: Skeleton, hidden: int, *, first: bool) -> Networks:
    """Build F-CNN of one character (table 17)."""
    sizes = [len(skeleton.joints)]
    for _ in range(3):
        sizes.append((sizes[-1] + 1) // 2)
    encoder: list[nn.Module] = []
    for number, (a, b) in enumerate(pairwise((3, hidden // 8, hidden // 4, hidden // 2, hidden))):
        encoder += [nn.Conv2d(a, b, (1, 3), padding=(0, 1)), nn.ReLU()]
        encoder += [nn.MaxPool2d((1, 2), ceil_mode=True)] if number else []
    # The first character's decoder does not mirror its encoder, in the table too.
    up = (hidden, hidden // 2, hidden // 8) if first else (hidden // 2, hidden // 4, hidden // 8)
    condition = 4 if first else 8
    decoder: list[nn.Module] = [dense(hidden + condition, hidden), nn.ReLU()]
    for (a, b), size in zip(pairwise((hidden, *up)), sizes[2::-1], strict=True):
        even = (0, 1 - size % 2)
        decoder += [nn.ConvTranspose2d(a, b, (1, 3), (1, 2), (0, 1), even), nn.ReLU()]
    pools = [nn.AvgPool2d((1, 2), ceil_mode=True) for _ in range(3)]
    return Networks(
        displacement_encoder=nn.Sequential(*encoder),
        condition=nn.Sequential(*pools),
        encoder=nn.Identity(),
        posterior=dense(hidden + condition, 2 * hidden),
        decoder=nn.Sequential(*decoder, dense(up[-1], 3)),
        latent=(hidden, sizes[-1]),
    )


def f_gcn(skeleton: Skeleton, hidden: int, *, first: bool) -> Networks:
    """Build F-GCN of one character (table 18)."""
    adjacency, condition = off_diagonal_adjacency(skeleton), 20 if first else 16

    def graph(into: int, out: int) -> nn.Sequential:
        return nn.Sequential(GraphConvolution(adjacency, into, out), nn.ReLU())

    eighth, quarter, half = hidden // 8, hidden // 4, hidden // 2
    down = hidden + condition, hidden, half, quarter, eighth
    return Networks(
        displacement_encoder=nn.Sequential(graph(3, eighth), graph(eighth, quarter)),
        condition=dense(4 if first else 6, condition),
        encoder=graph(quarter + condition, half),
        posterior=GraphConvolution(adjacency, half, 2 * hidden),
        decoder=nn.Sequential(
            *(graph(a, b) for a, b in pairwise(down)),
            GraphConvolution(adjacency, eighth, 3),
            dense(3, 3),
        ),
        latent=(hidden, len(skeleton.joints)),
    )


def m_cnn(skeleton: Skeleton, hidden: int, *, first: bool) -> Networks:
    """Build M-CNN of one character (table 19); no layer is wider than a quarter of ``hidden``."""
    wide, half, quarter = hidden // 4, hidden // 8, hidden // 16

    def convolution(into: int, out: int) -> nn.Sequential:
        return nn.Sequential(nn.Conv2d(into, out, 3, padding=1), nn.ReLU())

    def pooled(into: int, out: int) -> nn.Sequential:
        return nn.Sequential(convolution(into, out), nn.MaxPool2d((3, 1), 1, (1, 0)))

    last = (nn.Conv2d(quarter, 3, 3, padding=1), dense(3, 3)) if first else (dense(quarter, 3),)
    down = (4, quarter, half) if first else (16, half)
    return Networks(
        displacement_encoder=nn.Identity() if first else dense(3, 8),
        condition=nn.Identity(),
        encoder=nn.Sequential(*(pooled(a, b) for a, b in pairwise(down))),
        posterior=nn.Conv2d(half, 2 * wide, 3, padding=1),
        decoder=nn.Sequential(
            dense(wide + (1 if first else 8), wide),
            nn.ReLU(),
            *(convolution(a, b) for a, b in pairwise((wide, half, quarter))),
            *last,
        ),
        latent=(wide, len(skeleton.joints)),
    )


def m_gcn(skeleton: Skeleton, hidden: int, *, first: bool) -> Networks:
    """Build M-GCN of one character (table 20); no layer is wider than half of ``hidden``."""
    layer = partial(StGcnLayer, off_diagonal_adjacency(skeleton))
    wide, half, quarter = hidden // 2, hidden // 4, hidden // 8
    condition = 1 if first else PARTNER_CHANNELS
    encoder = nn.Sequential(
        layer((4 if first else 3, quarter), residual=False),
        layer((quarter, half)),
        layer((half, wide)),
    )
    down = [layer(pair) for pair in pairwise((wide + condition, wide, half, quarter))]
    last = (
        (layer((quarter, hidden // 16)), layer((hidden // 16, 3), final_relu=False))
        if first
        else (dense(quarter, 3),)
    )
    return Networks(
        displacement_encoder=nn.Identity() if first else encoder,
        condition=nn.Identity() if first else dense(6, PARTNER_CHANNELS),
        encoder=encoder if first else nn.Identity(),
        posterior=dense(wide + (0 if first else condition), 2 * wide),
        decoder=nn.Sequential(*down, *last),
        latent=(wide, len(skeleton.joints)),
    )


# Networks, and the features of the first and the second character's condition.
BASELINES: dict[
    str, tuple[Callable[..., Networks], tuple[Callable[[CharacterInputs], Tensor], ...]]
] = {
    "f_cnn": (f_cnn, (lambda given: given.template_features, lambda given: given.partner_features)),
    "f_gcn": (f_gcn, (lambda given: given.template_features, partner_positions)),
    "m_cnn": (m_cnn, (lambda given: given.scale_offsets, lambda given: given.partner_features)),
    "m_gcn": (m_gcn, (lambda given: given.scale_offsets, partner_positions)),
}


def build(config: PriorConfig) -> SkeletonPrior:
    """Build the baseline that ``config.model`` names."""
    networks, features = BASELINES[config.model]
    first, second = (
        BaselineVae(networks(config.skeleton, config.hidden, first=role == 0), features[role])
        for role in (0, 1)
    )
    return SkeletonPrior(config, (first, second), symmetric=False)
