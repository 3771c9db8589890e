"""Networks of the supplement (tables 11 to 20): the paper's model and its four baselines.

All yield displacements, normalised by their root mean square in the training data. Where the tables
are inconsistent or incomplete:

- A dense layer that yields the latent has two outputs, mean and log variance.
- The 8 input channels of ST-GCN3, and of the second character's condition in F-CNN and M-CNN, are
  the partner 3, the template 3 and both characters' scales.
- The 16 output channels of ST-GCN3 all enter G-GRU2, which so has 25 input channels where table 16
  says 10.
- F-CNN halves the number of joints: pooling rounds up, 25 to 13, 7 and 4, and transposed
  convolutions invert it. Conditions joined at an eighth of the joints are averaged over the same
  joints.
- The max-pooling of M-CNN keeps every frame and joint, so its stride is 1.
- Where the last layer of a decoder would end in a ReLU, displacements of either sign need none.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import torch
from torch import Tensor, nn

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.skeleton_prior.layers import (
    GraphConvolution,
    GraphGru,
    StGcnEncoder,
    StGcnLayer,
    encoder_channels,
    normalised_adjacency,
    off_diagonal_adjacency,
)
from pacmo_core.skeleton_prior.settings import PriorConfig
from pacmo_core.skeleton_prior.vae import (
    CharacterInputs,
    CharacterVae,
    DiagonalGaussian,
    SkeletonPrior,
)

# Output channels of ST-GCN3, the partner's encoder.
PARTNER_CHANNELS = 16
LEAKY_SLOPE = 0.1


def _channels_first(x: Tensor) -> Tensor:
    """Map ``(B, T, J, C)`` to ``(B, C, T, J)``."""
    return x.permute(0, 3, 1, 2)


def _displacements(motion: Tensor, given: CharacterInputs) -> Tensor:
    """``(B, 3, T, J)``: normalised displacements from the template."""
    return _channels_first((motion - given.template) / given.displacement_scale)


def _scale_offsets(given: CharacterInputs, *, of_partner: bool = False) -> Tensor:
    """``(B, 1, T, J)``: scales less 1, in every frame."""
    scales = given.partner_scales if of_partner else given.scales
    return (scales - 1)[:, None, None].expand(-1, -1, given.template.shape[1], -1)


def _template_features(given: CharacterInputs) -> Tensor:
    """``(B, 4, T, J)``: the template 3 and the scales less 1."""
    return torch.cat([_channels_first(given.template), _scale_offsets(given)], dim=1)


def _partner_positions(given: CharacterInputs) -> Tensor:
    """``(B, 6, T, J)``: the partner 3 and the template 3."""
    return torch.cat([_channels_first(given.partner), _channels_first(given.template)], dim=1)


def _partner_features(given: CharacterInputs) -> Tensor:
    """``(B, 8, T, J)``: the partner 3, the template 3, and both characters' scales less 1."""
    scales = _scale_offsets(given, of_partner=True), _scale_offsets(given)
    return torch.cat([_partner_positions(given), *scales], dim=1)


class AutoregressiveDecoder(nn.Module):
    """G-GRU1 and G-GRU2: the displacement of each frame is an input of the next step."""

    def __init__(self, skeleton: Skeleton, condition_channels: int, hidden: int) -> None:
        super().__init__()
        self.gru = GraphGru(normalised_adjacency(skeleton), condition_channels + 3, hidden)
        self.head = nn.Sequential(
            nn.Linear(hidden, hidden),
            nn.LeakyReLU(LEAKY_SLOPE),
            nn.Linear(hidden, hidden),
            nn.LeakyReLU(LEAKY_SLOPE),
            nn.Linear(hidden, 3),
        )

    def forward(self, condition: Tensor, state: Tensor, n_frames: int) -> Tensor:
        """Decode a condition (B, J, C) from the first state (B, J, h) to ``(B, T, J, 3)``."""
        displacements = [condition.new_zeros(*condition.shape[:2], 3)]
        adjacency = self.gru.adjacency()
        for _ in range(n_frames):
            state = self.gru(torch.cat([condition, displacements[-1]], dim=-1), state, adjacency)
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
        self.hidden = hidden
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

    def latent_shape(self, template: Tensor) -> tuple[int, ...]:
        """Return the shape of one latent per joint."""
        return (len(template), template.shape[2], self.hidden)

    def encode(self, motion: Tensor, given: CharacterInputs) -> DiagonalGaussian:
        """Encode displacements, and the scales or the partner (tables 11; 13 to 15)."""
        x = _displacements(motion, given)
        if self.partner_encoder is None:
            parts = [self.encoder(torch.cat([x, _scale_offsets(given)], dim=1))]
        else:
            parts = [self.encoder(x), self.partner_encoder(_partner_features(given))]
        fused = self.fusion(torch.cat([*parts, *self._end_poses(given)], dim=-1))
        return DiagonalGaussian.from_output(self.posterior(fused))

    def decode(self, latent: Tensor, given: CharacterInputs) -> Tensor:
        """Decode from the scales or the partner, and the template's first and last pose."""
        if self.partner_encoder is None:
            condition = (given.scales - 1)[..., None]
        else:
            condition = self.partner_encoder(_partner_features(given))
        condition = torch.cat([condition, *self._end_poses(given)], dim=-1)
        output: Tensor = self.decoder(condition, latent, given.template.shape[1])
        return output * given.displacement_scale

    @staticmethod
    def _end_poses(given: CharacterInputs) -> tuple[Tensor, Tensor]:
        return given.template[:, 0], given.template[:, -1]


@dataclass(frozen=True)
class Networks:
    """The networks of one baseline and character, on ``(B, C, T, J)``."""

    features: Callable[[CharacterInputs], Tensor]  # of the condition
    displacement_encoder: nn.Module  # of the displacements alone
    condition: nn.Module  # of the condition's features
    encoder: nn.Module  # of both side by side
    posterior: nn.Module  # to mean and log variance
    decoder: nn.Module  # of latent and condition to displacements
    latent: tuple[int, int]  # its channels and joints


class BaselineVae(CharacterVae):
    """A baseline of one character: a latent for each frame, decoded beside the condition."""

    def __init__(self, networks: Networks) -> None:
        super().__init__()
        self.features, self.latent = networks.features, networks.latent
        self.displacement_encoder, self.encoder = networks.displacement_encoder, networks.encoder
        self.condition, self.posterior = networks.condition, networks.posterior
        self.decoder = networks.decoder

    def latent_shape(self, template: Tensor) -> tuple[int, ...]:
        """Return the shape of one latent per frame and joint, or per eighth of the joints."""
        channels, joints = self.latent
        return (len(template), channels, template.shape[1], joints)

    def encode(self, motion: Tensor, given: CharacterInputs) -> DiagonalGaussian:
        """Encode displacements and condition."""
        encoded = self.displacement_encoder(_displacements(motion, given))
        encoded = self.encoder(self._with_condition(encoded, given))
        return DiagonalGaussian.from_output(self.posterior(encoded), dim=1)

    def decode(self, latent: Tensor, given: CharacterInputs) -> Tensor:
        """Decode displacements."""
        output: Tensor = self.decoder(self._with_condition(latent, given))
        return output.permute(0, 2, 3, 1) * given.displacement_scale

    def _with_condition(self, x: Tensor, given: CharacterInputs) -> Tensor:
        return torch.cat([x, self.condition(self.features(given))], dim=1)


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
        features=_template_features if first else _partner_features,
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
        features=_template_features if first else _partner_positions,
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
        features=_scale_offsets if first else _partner_features,
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
        features=_scale_offsets if first else _partner_positions,
        displacement_encoder=nn.Identity() if first else encoder,
        condition=nn.Identity() if first else dense(6, PARTNER_CHANNELS),
        encoder=encoder if first else nn.Identity(),
        posterior=dense(wide + (0 if first else condition), 2 * wide),
        decoder=nn.Sequential(*down, *last),
        latent=(wide, len(skeleton.joints)),
    )


BASELINES = {"f_cnn": f_cnn, "f_gcn": f_gcn, "m_cnn": m_cnn, "m_gcn": m_gcn}


def build(config: PriorConfig) -> SkeletonPrior:
    """Build the paper's model, or the baseline that ``config.model`` names."""

    def character(*, first: bool) -> CharacterVae:
        if config.model == "paper":
            return PaperVae(config.skeleton, hidden=config.hidden, first=first)
        networks = BASELINES[config.model]
        return BaselineVae(networks(config.skeleton, config.hidden, first=first))

    return SkeletonPrior(config, character(first=True), character(first=False))
