"""The kinematic model: bone rotations and limb IK, linear in the change of the skeletons.

Unlike the paper, whose decoders take the first and the last pose of the template and a latent of
the partner, every frame's joint features contain the template, the initial motion, and what the
interaction mesh asks of the character. All features are known before decoding, so no output is fed
back. The output is added to the start (``start.initial_output``), or to nothing.
"""

import torch
from torch import Tensor, nn

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.skeleton_prior.kinematics import (
    MIN_LENGTH,
    KinematicOutput,
    Limb,
    multiply_joints,
)
from pacmo_core.skeleton_prior.layers import (
    GraphGru,
    StGcnEncoder,
    StGcnLayer,
    ZeroInitLinear,
    encoder_channels,
    normalised_adjacency,
    off_diagonal_adjacency,
    output_head,
)
from pacmo_core.skeleton_prior.settings import PriorConfig, StartSettings
from pacmo_core.skeleton_prior.skeleton_vae import DiagonalGaussian
from pacmo_core.skeleton_prior.start import contact_weights, initial_output, stand
from pacmo_core.skeleton_prior.vae import (
    CharacterInputs,
    CharacterVae,
    SkeletonPrior,
    channels_first,
)

# With its joint features the model needs a quarter of the paper's channels.
HIDDEN_DIVISOR, MIN_HIDDEN = 4, 16
# Channels of ``KinematicVae.joint_features``.
N_JOINT_FEATURES = 30
# Smallest change of the skeletons that features are normalised by.
MIN_SCALE_CHANGE = 1e-3
# Scales the network's output, which is of order 1, to the change of a joint per unit scale change.
OUTPUT_GAIN = 0.3
# Metres: added to distances, so that the weights of touching joints stay finite.
DISTANCE_SOFTENING = 0.01
# Metres: distance at which the contact weight of two joints has fallen to 1/e.
CONTACT_DISTANCE = 0.15


class KinematicDecoder(nn.Module):
    """From joint features and a latent to the input of the output layer."""

    def __init__(self, skeleton: Skeleton, *, hidden: int) -> None:
        super().__init__()
        adjacency = off_diagonal_adjacency(skeleton)
        self.feature_norm = nn.BatchNorm2d(N_JOINT_FEATURES)  # features have different units
        self.linear = nn.Conv2d(2 * N_JOINT_FEATURES, hidden, 1)  # of a joint, and of their mean
        self.st_gcn = nn.Sequential(*(StGcnLayer(adjacency, (hidden, hidden)) for _ in range(2)))
        self.gru = GraphGru(normalised_adjacency(skeleton), hidden, hidden)
        self.head = output_head(2 * hidden, 3, last=ZeroInitLinear)

    def forward(self, features: Tensor, latent: Tensor) -> Tensor:
        """Map ``(B, 30, T, J)`` and ``(B, J, h)`` to ``(B, T, J, 3)``."""
        normalised = self.feature_norm(features)
        mean = normalised.mean(dim=-1, keepdim=True).expand_as(normalised)
        x = self.st_gcn(self.linear(torch.cat([normalised, mean], dim=1))).permute(0, 2, 3, 1)
        output: Tensor = self.head(torch.cat([self.gru(x, latent), x], dim=-1))
        return output


class KinematicVae(CharacterVae):
    """VAE of a character with exact bone lengths; both characters have the same architecture.

    The network's output is added to a start, or to the scaled posture.
    """

    def __init__(
        self,
        skeleton: Skeleton,
        limbs: tuple[Limb, ...],
        *,
        hidden: int,
        start: StartSettings | None,
    ) -> None:
        super().__init__()
        self.hidden, self.start = hidden, start
        self.output_layer = self.kinematics = KinematicOutput(skeleton, limbs)
        self.encoder = StGcnEncoder(off_diagonal_adjacency(skeleton), 4, encoder_channels(hidden))
        self.posterior = nn.Linear(hidden + 6, 2 * hidden)
        self.decoder = KinematicDecoder(skeleton, hidden=hidden)

    def latent_shape(self, inputs: CharacterInputs) -> tuple[int, ...]:
        """Return the shape of one latent per joint."""
        rows, _, joints, _ = inputs.template.shape
        return (rows, joints, self.hidden)

    def encode(self, motion: Tensor, inputs: CharacterInputs) -> DiagonalGaussian:
        """Encode the difference from the initial motion, and the scales."""
        size = scale_change(inputs)
        initial = self.output_layer(self.initial_output(inputs), inputs.template, inputs.scales)
        change = channels_first((motion - initial) / (size * OUTPUT_GAIN))
        scales = (inputs.scales.log()[:, None, None] / size).expand(-1, -1, motion.shape[1], -1)
        encoded = self.encoder(torch.cat([change, scales], dim=1))
        output = self.posterior(torch.cat([encoded, inputs.end_poses], dim=-1))
        return DiagonalGaussian.from_output(output)

    def decode(self, latent: Tensor, inputs: CharacterInputs) -> Tensor:
        """Add the network's output, in proportion to the scale change, to the initial output."""
        initial = self.initial_output(inputs)
        features = self.joint_features(inputs, initial)
        output: Tensor = self.decoder(channels_first(features), latent)
        return initial + output * (OUTPUT_GAIN * scale_change(inputs))

    def expected_partner(self, template: Tensor, scales: Tensor) -> Tensor:
        """Expect the partner where the ground has it; without a start, in its scaled posture."""
        if self.start is None:
            return self.kinematics.scaled_posture(template, scales)
        return stand(self.kinematics, self.start, template, scales)

    def initial_output(self, inputs: CharacterInputs) -> Tensor:
        """Compute what the network's output is added to, (B, T, J, 3)."""
        if self.start is None:
            return torch.zeros_like(inputs.template)
        return initial_output(
            self.kinematics,
            self.start,
            (inputs.template, inputs.scales),
            (inputs.partner_template, inputs.partner),
            partner_yields=inputs.partner_yields,
        )

    def joint_features(self, inputs: CharacterInputs, initial: Tensor) -> Tensor:
        """Compute features of all joints and frames, (B, T, J, 30), per unit scale change."""
        template, size = inputs.template, scale_change(inputs)
        change = (self.output_layer(initial, template, inputs.scales) - template) / size
        residuals = mesh_residual_features(
            template,
            inputs.partner_template,
            change,
            (inputs.partner - inputs.partner_template) / size,
        )
        bones = self.kinematics.bone_vectors(template)
        lengths = bones.norm(dim=-1, keepdim=True)
        own, partner = inputs.scales.log(), inputs.partner_scales.log().mean(dim=1, keepdim=True)
        scales = torch.stack([own, partner.expand_as(own)], dim=-1)[:, None] / size
        # Sums over each joint's descendants: gradients of the mesh energies by the bone vectors.
        energies = torch.cat([change, residuals[..., :6]], dim=-1)
        bone_gradients = multiply_joints(self.kinematics.ancestor_matrix.T, energies)
        speed = torch.diff(template, dim=1, append=template[:, -1:]).norm(dim=-1, keepdim=True)
        parts = [
            scales.expand(-1, template.shape[1], -1, -1),
            change,
            residuals,
            bones / lengths.clamp_min(MIN_LENGTH),
            template[..., 1:2],
            10 * speed,
            lengths,
            bone_gradients / template.shape[2],
        ]
        return torch.cat(parts, dim=-1)


def mesh_residual_features(
    character: Tensor, partner: Tensor, character_change: Tensor, partner_change: Tensor
) -> Tensor:
    """Compute the residuals of the interaction mesh between the characters, per joint.

    The mesh connects each joint with all joints of the partner (Ho et al. 2010; supplement,
    section 1), with weights inverse to the distance, or with contact weights. Both residuals are
    zero where a joint's position relative to its weighted neighbours is that of the template.

    Parameters
    ----------
    character, partner : (B, T, J, 3), metres, template positions
    character_change, partner_change : (B, T, J, 3), metres, displacements from the template

    Returns
    -------
    (B, T, J, 10): residual by inverse distance 3, residual by contact 3, sum of contact weights 1,
    vector to the weighted mean of the partner's joints 3
    """
    weights = 1 / (torch.cdist(character, partner) + DISTANCE_SOFTENING)
    weights = weights / weights.sum(dim=-1, keepdim=True)
    contact = contact_weights(character, partner, CONTACT_DISTANCE)
    contact_sum = contact.sum(dim=-1, keepdim=True)
    means = weights @ torch.cat([partner_change, partner], dim=-1)
    residual = means[..., :3] - character_change
    contact_residual = contact @ partner_change - contact_sum * character_change
    return torch.cat([residual, contact_residual, contact_sum, means[..., 3:] - character], dim=-1)


def scale_change(inputs: CharacterInputs) -> Tensor:
    """Compute the root mean square log scale of both characters, ``(B, 1, 1, 1)``."""
    both = torch.cat([inputs.scales, inputs.partner_scales], dim=1)
    size = both.log().square().mean(dim=1).sqrt()
    return size.clamp_min(MIN_SCALE_CHANGE)[:, None, None, None]


def build(config: PriorConfig) -> SkeletonPrior:
    """Build the kinematic model, with the start or without it."""
    hidden = max(MIN_HIDDEN, config.hidden // HIDDEN_DIVISOR)
    start = config.start if config.model == "kinematic" else None
    first, second = (
        KinematicVae(config.skeleton, config.limbs, hidden=hidden, start=start) for _ in range(2)
    )
    return SkeletonPrior(config, (first, second), symmetric=True)
