"""The kinematic model: a network whose output is added to the start.

Unlike the paper, whose decoders take the first and the last pose of the template and a latent of
the partner, every frame's features (``FrameFeatures``) contain both templates, what the start does
to the character, and what contacts ask of it. They are coordinates of the character's own body, so
that neither place nor heading matters. All are known before decoding: no output is fed back.

The networks take all joints of a frame at once, with weights of their own for each, and look along
time by convolutions of single channels.
"""

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.skeleton_prior.kinematics import KinematicOutput, Limb
from pacmo_core.skeleton_prior.layers import TEMPORAL_KERNEL, ZeroInitLinear
from pacmo_core.skeleton_prior.settings import PriorConfig
from pacmo_core.skeleton_prior.start import contact_weights, initial_output, stand
from pacmo_core.skeleton_prior.vae import (
    CharacterInputs,
    CharacterVae,
    DiagonalGaussian,
    SkeletonPrior,
)

# Elements of the latent of a window.
LATENT = 16
# Keyframes between the taps of the blocks' convolutions over time.
DILATIONS = (1, 3, 9)
# The encoder has so many times fewer channels than the decoder: it yields few numbers a window.
ENCODER_DIVISOR = 4
# Scales the network's output, which is of order 1, to the change of a joint per unit scale change.
OUTPUT_GAIN = 0.3
# Metres: distances at which the weight of two joints is 1/e: of contact, of nearness.
RANGES = (0.15, 0.5)
# Added to the sum of a joint's weights, so that means over a partner out of range tend to zero.
NO_PARTNER = 0.1
# Metres: horizontal distance of left from right below which the heading is that of the world.
MIN_LATERAL = 1e-3
# Normalised features are clipped to so many standard deviations: what is rare in training may be
# common in use, such as contact.
MAX_DEVIATION = 5.0
# Of each joint: five vectors; for each range two vectors and a sum of weights; two scales.
PER_JOINT = 3 * (5 + 2 * len(RANGES)) + len(RANGES) + 2


class FrameFeatures(nn.Module):
    """Normalised features of each frame (B, T, F); nothing in it is trained by gradients.

    Of the pose: joint positions of character and partner from the character's root on the ground,
    velocities, and from each joint to the partner's joints near it. Per unit scale change: what
    the initial motion changes, what is known of the partner's change, by how much more the
    partner's joints near a joint move than it does, and the scales of both.
    """

    left: Tensor
    right: Tensor

    def __init__(self, skeleton: Skeleton, limbs: tuple[Limb, ...]) -> None:
        super().__init__()
        starts = {start for start, _, _ in limbs}
        pairs = [p for p in skeleton.left_right if starts & set(p)] or list(skeleton.left_right)
        left, right = torch.tensor(pairs, dtype=torch.int64).reshape(-1, 2).T
        self.root, self.size = skeleton.root, PER_JOINT * len(skeleton.joints)
        self.norm = nn.BatchNorm1d(self.size, affine=False)  # features have different units
        self.register_buffer("left", left, persistent=False)
        self.register_buffer("right", right, persistent=False)

    def forward(self, initial: Tensor, inputs: CharacterInputs, axes: Tensor) -> Tensor:
        """Compute the features, of an initial motion (B, T, J, 3) of the character."""
        template, partner, size = inputs.template, inputs.partner_template, inputs.scale_change
        on_ground = template[:, :, self.root, None] * template.new_tensor([1.0, 0.0, 1.0])
        own_change, partner_change = (initial - template) / size, (inputs.partner - partner) / size
        vectors = [
            template - on_ground,
            partner - on_ground,
            10 * torch.diff(template, dim=1, append=template[:, -1:]),
            own_change,
            partner_change,
        ]
        sums = []
        for radius in RANGES:
            weights = contact_weights(inputs.squared_distances, radius)
            total = weights.sum(dim=-1, keepdim=True)
            means = weights @ torch.cat([partner, partner_change], dim=-1)
            own = total * torch.cat([template, own_change], dim=-1)
            vectors += ((means - own) / (total + NO_PARTNER)).chunk(2, dim=-1)
            sums.append(total / (total + 1))
        local = torch.cat(vectors, dim=2) @ axes.mT
        scales = torch.stack([inputs.scales, inputs.partner_scales], dim=1).log().flatten(1)
        scales = (scales[:, None] / size[..., 0]).expand(-1, template.shape[1], -1)
        features = torch.cat([local.flatten(2), torch.cat(sums, dim=2).flatten(2), scales], dim=-1)
        normalised: Tensor = self.norm(features.flatten(0, 1)).view_as(features)
        return normalised.clamp(-MAX_DEVIATION, MAX_DEVIATION)

    def axes(self, template: Tensor) -> Tensor:
        """Compute the axes of each frame (B, T, 3, 3): left, up and forward."""
        lateral = (template[:, :, self.left] - template[:, :, self.right]).sum(dim=2)
        lateral = lateral * template.new_tensor([1.0, 0.0, 1.0])
        length = lateral.norm(dim=-1, keepdim=True)
        x = template.new_tensor([1.0, 0.0, 0.0])
        left = torch.where(length > MIN_LATERAL, lateral / length.clamp_min(MIN_LATERAL), x)
        up = template.new_tensor([0.0, 1.0, 0.0]).expand_as(left)
        return torch.stack([left, up, torch.linalg.cross(left, up)], dim=-2)


class TemporalBlock(nn.Module):
    """Residual block: a convolution of each channel over time, then a mix of the channels."""

    def __init__(self, width: int, dilation: int) -> None:
        super().__init__()
        self.padding = (dilation * (TEMPORAL_KERNEL // 2),) * 2
        self.temporal = nn.Conv1d(width, width, TEMPORAL_KERNEL, dilation=dilation, groups=width)
        self.mix = nn.Linear(width, width)

    def forward(self, x: Tensor) -> Tensor:
        """Map ``(B, T, C)`` to the same shape."""
        padded = nn.functional.pad(x.mT, self.padding, mode="replicate")
        mixed: Tensor = self.mix(nn.functional.silu(self.temporal(padded).mT))
        return x + mixed


def temporal_network(n_features: int, width: int) -> nn.Sequential:
    """Build a network from features of a frame ``(B, T, F)`` to ``(B, T, width)``."""
    blocks = (TemporalBlock(width, dilation) for dilation in DILATIONS)
    return nn.Sequential(nn.Linear(n_features, width), *blocks, nn.SiLU())


@dataclass(frozen=True)
class Condition:
    """What is computed of a character's inputs before its networks."""

    output: Tensor  # (B, T, J, 3), to which the network's output is added
    motion: Tensor  # (B, T, J, 3), metres: the initial motion, of that output
    axes: Tensor  # (B, T, 3, 3), of the body
    features: Tensor  # (B, T, F), normalised
    gain: Tensor  # (B, 1, 1, 1), of the network's output: proportional to the scale change


class KinematicVae(CharacterVae):
    """VAE of a character with exact bone lengths; both characters have the same architecture.

    The network's output is added to a start, or to the scaled posture.
    """

    has_exact_bones = symmetric = True

    def __init__(self, config: PriorConfig) -> None:
        super().__init__()
        self.start = config.start if config.model == "kinematic" else None
        self.kinematics = KinematicOutput(config.skeleton, config.limbs)
        self.features = FrameFeatures(config.skeleton, config.limbs)
        features, outputs = self.features.size, 3 * len(config.skeleton.joints)
        encoded = config.hidden // ENCODER_DIVISOR
        self.encoder = temporal_network(features + outputs, encoded)
        self.posterior = nn.Linear(encoded, 2 * LATENT)
        self.decoder = temporal_network(features + LATENT, config.hidden)
        self.head = ZeroInitLinear(config.hidden, outputs)

    def latent_shape(self, template: Tensor) -> tuple[int, ...]:
        """Return the shape of one latent per window."""
        return (len(template), LATENT)

    def compute_condition(self, inputs: CharacterInputs) -> Condition:
        """Compute what encoder and decoder are told; no weight takes part in it."""
        with torch.no_grad():
            output = torch.zeros_like(inputs.template)
            if self.start is not None:
                output = initial_output(
                    self.kinematics,
                    self.start,
                    (inputs.template, inputs.scales),
                    (inputs.squared_distances, inputs.partner - inputs.partner_template),
                    partner_yields=inputs.partner_yields,
                )
            motion = self.kinematics(output, inputs.template, inputs.scales)
            axes = self.features.axes(inputs.template)
            features = self.features(motion, inputs, axes)
            return Condition(output, motion, axes, features, OUTPUT_GAIN * inputs.scale_change)

    def encode(self, motion: Tensor, given: Condition) -> DiagonalGaussian:
        """Encode the features and the difference from the initial motion."""
        local = ((motion - given.motion) / given.gain) @ given.axes.mT
        encoded = self.encoder(torch.cat([given.features, local.flatten(2)], dim=-1)).mean(dim=1)
        return DiagonalGaussian.from_output(self.posterior(encoded))

    def decode(self, latent: Tensor, given: Condition) -> Tensor:
        """Add the network's output, in proportion to the scale change, to the initial output."""
        expanded = latent[:, None].expand(-1, given.features.shape[1], -1)
        decoded = self.decoder(torch.cat([given.features, expanded], dim=-1))
        change: Tensor = self.head(decoded).unflatten(-1, (-1, 3)) @ given.axes
        return given.output + change * given.gain

    def expected_partner(self, template: Tensor, scales: Tensor) -> Tensor:
        """Expect the partner where the ground has it; without a start, in its scaled posture."""
        if self.start is None:
            return self.kinematics.scaled_posture(template, scales)
        return stand(self.kinematics, self.start, template, scales)

    def joint_positions(self, output: Tensor, template: Tensor, scales: Tensor) -> Tensor:
        """Apply the output by forward and inverse kinematics."""
        motion: Tensor = self.kinematics(output, template, scales)
        return motion


def build(config: PriorConfig) -> SkeletonPrior:
    """Build the kinematic model, with the start or without it."""
    return SkeletonPrior(config, KinematicVae(config), KinematicVae(config))
