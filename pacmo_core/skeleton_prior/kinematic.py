"""The kinematic model: a network whose output is added to the start.

Unlike the paper, whose decoders take the first and the last pose of the template and a latent of
the partner, every frame's features (``frame_features``) contain both templates, what the start does
to the character, and what contacts ask of it. They are coordinates of the character's own body, so
that neither place nor heading matters. All are known before decoding: no output is fed back.

The networks take all joints of a frame at once, with weights of their own for each, and look along
time by convolutions of single channels.
"""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.skeleton_prior.frame_features import FrameFeatures
from pacmo_core.skeleton_prior.kinematics import KinematicOutput, Limb
from pacmo_core.skeleton_prior.layers import TEMPORAL_KERNEL, ZeroInitLinear
from pacmo_core.skeleton_prior.settings import PriorConfig, StartSettings
from pacmo_core.skeleton_prior.skeleton_vae import DiagonalGaussian
from pacmo_core.skeleton_prior.start import initial_output, stand
from pacmo_core.skeleton_prior.vae import CharacterInputs, CharacterVae, SkeletonPrior

# Elements of the latent of a window.
LATENT = 16
# Keyframes between the taps of the blocks' convolutions over time.
DILATIONS = (1, 3, 9)
# The encoder has so many times fewer channels than the decoder: it yields few numbers a window.
ENCODER_DIVISOR = 4
# Scales the network's output, which is of order 1, to the change of a joint per unit scale change.
OUTPUT_GAIN = 0.3


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


class TemporalNetwork(nn.Sequential):
    """Features of a frame ``(B, T, F)`` to ``(B, T, width)``."""

    def __init__(self, n_features: int, width: int) -> None:
        super().__init__(
            nn.Linear(n_features, width),
            *(TemporalBlock(width, d) for d in DILATIONS),
            nn.SiLU(),
        )


@dataclass(frozen=True)
class Condition:
    """What is computed of a character's inputs before its networks."""

    output: Tensor  # (B, T, J, 3), to which the network's output is added
    motion: Tensor  # (B, T, J, 3), metres: the initial motion, of that output
    axes: Tensor  # (B, T, 3, 3), of the body
    features: Tensor  # (B, T, F), normalised


class KinematicVae(CharacterVae):
    """VAE of a character with exact bone lengths; both characters have the same architecture.

    The network's output is added to a start, or to the scaled posture.
    """

    has_exact_bones = True

    def __init__(
        self,
        skeleton: Skeleton,
        limbs: tuple[Limb, ...],
        *,
        hidden: int,
        start: StartSettings | None,
    ) -> None:
        super().__init__()
        self.start = start
        self.output_layer = self.kinematics = KinematicOutput(skeleton, limbs)
        self.features = FrameFeatures(skeleton, limbs)
        features, outputs = self.features.size, 3 * len(skeleton.joints)
        self.encoder = TemporalNetwork(features + outputs, hidden // ENCODER_DIVISOR)
        self.posterior = nn.Linear(hidden // ENCODER_DIVISOR, 2 * LATENT)
        self.decoder = TemporalNetwork(features + LATENT, hidden)
        self.head = ZeroInitLinear(hidden, outputs)

    def latent_shape(self, inputs: CharacterInputs) -> tuple[int, ...]:
        """Return the shape of one latent per window."""
        return (len(inputs.template), LATENT)

    def encode(self, motion: Tensor, inputs: CharacterInputs) -> DiagonalGaussian:
        """Encode the features and the difference from the initial motion."""
        return self._encode(motion, inputs, self.condition(inputs))

    def decode(self, latent: Tensor, inputs: CharacterInputs) -> Tensor:
        """Add the network's output, in proportion to the scale change, to the initial output."""
        return self._decode(latent, inputs, self.condition(inputs))

    def reconstruct(
        self, motion: Tensor, inputs: CharacterInputs, sample: Callable[[DiagonalGaussian], Tensor]
    ) -> tuple[Tensor, DiagonalGaussian]:
        """Encode and decode a motion; the condition is computed once."""
        condition = self.condition(inputs)
        posterior = self._encode(motion, inputs, condition)
        output = self._decode(sample(posterior), inputs, condition)
        return self.output_layer(output, inputs.template, inputs.scales), posterior

    def condition(self, inputs: CharacterInputs) -> Condition:
        """Compute what encoder and decoder are told; no weight takes part in it."""
        with torch.no_grad():
            output = self.initial_output(inputs)
            motion = self.output_layer(output, inputs.template, inputs.scales)
            axes = self.features.axes(inputs.template)
            features = self.features(motion, inputs, axes)
        return Condition(output, motion, axes, features)

    def _encode(
        self, motion: Tensor, inputs: CharacterInputs, condition: Condition
    ) -> DiagonalGaussian:
        change = (motion - condition.motion) / (OUTPUT_GAIN * inputs.scale_change)
        local = (change @ condition.axes.mT).flatten(2)
        encoded = self.encoder(torch.cat([condition.features, local], dim=-1)).mean(dim=1)
        return DiagonalGaussian.from_output(self.posterior(encoded))

    def _decode(self, latent: Tensor, inputs: CharacterInputs, condition: Condition) -> Tensor:
        expanded = latent[:, None].expand(-1, condition.features.shape[1], -1)
        decoded = self.decoder(torch.cat([condition.features, expanded], dim=-1))
        change: Tensor = self.head(decoded).unflatten(-1, (-1, 3)) @ condition.axes
        return condition.output + change * (OUTPUT_GAIN * inputs.scale_change)

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
            (inputs.squared_distances, inputs.partner - inputs.partner_template),
            partner_yields=inputs.partner_yields,
        )


def build(config: PriorConfig) -> SkeletonPrior:
    """Build the kinematic model, with the start or without it."""
    start = config.start if config.model == "kinematic" else None
    first, second = (
        KinematicVae(config.skeleton, config.limbs, hidden=config.hidden, start=start)
        for _ in range(2)
    )
    return SkeletonPrior(config, (first, second), symmetric=True)
