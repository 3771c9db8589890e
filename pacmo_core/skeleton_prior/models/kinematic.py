"""The kinematic model: bone rotations and limb IK, linear in the change of the skeletons.

Unlike the paper, whose decoders take the first and the last pose of the template and a latent of
the partner, every frame's joint features contain the template, the initial estimate, and the
residuals of the interaction mesh between the two. All features are known before decoding, so no
output is fed back.
"""

import torch
from torch import Tensor, nn

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.skeleton_prior.autograd_functions import multiply_joints
from pacmo_core.skeleton_prior.kinematics import (
    MIN_LENGTH,
    KinematicOutput,
    Limb,
    mesh_residual_features,
)
from pacmo_core.skeleton_prior.layers import (
    ChannelBatchNorm,
    ConcatLinear,
    GraphGru,
    OutputHead,
    StGcnEncoder,
    StGcnLayer,
    ZeroInitLinear,
    batch_first,
    encoder_channels,
    frames_first,
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

# With its joint features the model needs a quarter of the paper's channels.
HIDDEN_DIVISOR, MIN_HIDDEN = 4, 16
# Channels of ``KinematicVae.joint_features``.
N_JOINT_FEATURES = 30
# Smallest change of the skeletons that features are normalised by.
MIN_SCALE_CHANGE = 1e-3
# Scales the network's output, which is of order 1, to the change of a joint per unit scale change.
OUTPUT_GAIN = 0.3
# Frames per pass of the output head: more would not fit in the processor's cache.
HEAD_FRAMES = 4


class KinematicDecoder(nn.Module):
    """From joint features and a latent to the input of the output layer.

    Parameters
    ----------
    skeleton : Skeleton
    hidden : channels
    """

    def __init__(self, skeleton: Skeleton, *, hidden: int) -> None:
        super().__init__()
        adjacency = off_diagonal_adjacency(skeleton)
        # Features have different units.
        self.feature_norm = ChannelBatchNorm(N_JOINT_FEATURES)
        self.joint_linear = ConcatLinear(N_JOINT_FEATURES, hidden)
        self.mean_linear = ConcatLinear(N_JOINT_FEATURES, hidden, bias=False)
        self.st_gcn = nn.ModuleList(
            [
                StGcnLayer(adjacency, hidden, hidden, stride=1, dropout=0.0, residual=True)
                for _ in range(2)
            ]
        )
        self.gru = GraphGru(normalised_adjacency(skeleton), hidden, hidden)
        self.head = OutputHead(2 * hidden, 3, last=ZeroInitLinear)

    def forward(self, features: Tensor, latent: Tensor) -> Tensor:
        """Map ``(B, T, J, 30)`` and ``(B, J, h)`` to ``(B, T, J, 3)``."""
        normalised = self.feature_norm(frames_first(features))
        mean = normalised.mean(dim=1, keepdim=True)
        x = self.joint_linear(normalised) + self.mean_linear(mean)
        for layer in self.st_gcn:
            x = layer(x, None)
        states = self.gru(x, latent.transpose(0, 1).contiguous())
        parts = zip(states.split(HEAD_FRAMES), x.split(HEAD_FRAMES), strict=True)
        return batch_first(torch.cat([self.head(*pair) for pair in parts]))


class KinematicVae(CharacterVae):
    """VAE of a character with exact bone lengths; both characters have the same architecture.

    Parameters
    ----------
    skeleton : Skeleton
    limbs : its arms and legs
    hidden : channels
    dropout : probability, in the encoder
    """

    def __init__(
        self, skeleton: Skeleton, limbs: tuple[Limb, ...], *, hidden: int, dropout: float
    ) -> None:
        super().__init__()
        self.hidden = hidden
        self.output_layer = self.kinematics = KinematicOutput(skeleton, limbs)
        self.encoder = StGcnEncoder(
            off_diagonal_adjacency(skeleton), 4, encoder_channels(hidden), dropout=dropout
        )
        self.posterior = GaussianHead(hidden + 6, hidden)
        self.decoder = KinematicDecoder(skeleton, hidden=hidden)

    def latent_shape(self, inputs: CharacterInputs) -> tuple[int, ...]:
        """Return the shape of one latent per joint."""
        rows, _, joints, _ = inputs.template.shape
        return (rows, joints, self.hidden)

    def encode(
        self, motion: Tensor, inputs: CharacterInputs, random: torch.Generator | None
    ) -> DiagonalGaussian:
        """Encode the difference from the initial motion, and the scales."""
        size = scale_change(inputs)
        change = (motion - inputs.initial_motion) / (size * OUTPUT_GAIN)
        scales = _normalised_log_scales(inputs.scales, size)
        scales = scales[:, None].expand(-1, motion.shape[1], -1, -1)
        encoded = self.encoder(torch.cat([change, scales], dim=-1), random)
        posterior: DiagonalGaussian = self.posterior(torch.cat([encoded, inputs.end_poses], dim=-1))
        return posterior

    def decode(self, latent: Tensor, inputs: CharacterInputs) -> Tensor:
        """Add the network's output, in proportion to the scale change, to the initial output."""
        output: Tensor = self.decoder(self.joint_features(inputs), latent)
        return inputs.initial_output + output * (OUTPUT_GAIN * scale_change(inputs))

    def joint_features(self, inputs: CharacterInputs) -> Tensor:
        """Compute features of all joints and frames, (B, T, J, 30), per unit scale change."""
        template, size = inputs.template, scale_change(inputs)
        character_change = inputs.initial_motion - template
        partner_change = inputs.partner - inputs.partner_template
        residuals = mesh_residual_features(
            template, inputs.partner_template, character_change / size, partner_change / size
        )
        bones = self.kinematics.bone_vectors(template)
        directions = bones / bones.norm(dim=-1, keepdim=True).clamp_min(MIN_LENGTH)
        scales = torch.cat(
            [
                _normalised_log_scales(inputs.scales, size),
                _normalised_log_scales(inputs.partner_scales, size)
                .mean(dim=1, keepdim=True)
                .expand(-1, template.shape[2], -1),
            ],
            dim=-1,
        )
        # Sums over each joint's descendants: gradients of the mesh energies by the bone vectors.
        energies = torch.cat([character_change / size, residuals[..., :6]], dim=-1)
        bone_gradients = multiply_joints(self.kinematics.ancestor_matrix.T, energies)
        speed = torch.diff(template, dim=1, append=template[:, -1:]).norm(dim=-1, keepdim=True)
        parts = [
            scales[:, None].expand(-1, template.shape[1], -1, -1),
            character_change / size,
            residuals,
            directions,
            template[..., 1:2],
            10 * speed,
            bones.norm(dim=-1, keepdim=True),
            bone_gradients / template.shape[2],
        ]
        return torch.cat(parts, dim=-1)


def scale_change(inputs: CharacterInputs) -> Tensor:
    """Compute the root mean square log scale of both characters, ``(B, 1, 1, 1)``."""
    both = torch.cat([inputs.scales, inputs.partner_scales], dim=1)
    size = both.log().square().mean(dim=1).sqrt()
    return size.clamp_min(MIN_SCALE_CHANGE)[:, None, None, None]


def _normalised_log_scales(scales: Tensor, size: Tensor) -> Tensor:
    """Divide log scales (B, J) by the scale change: ``(B, J, 1)``."""
    return (scales.log() / size[:, 0, :, 0])[..., None]


def build(config: PriorConfig) -> SkeletonPrior:
    """Build the kinematic model."""
    hidden = max(MIN_HIDDEN, config.hidden // HIDDEN_DIVISOR)
    first, second = (
        KinematicVae(config.skeleton, config.limbs, hidden=hidden, dropout=config.dropout)
        for _ in range(2)
    )
    return SkeletonPrior(config, (first, second), symmetric=True)
