"""Variational autoencoders (VAEs) of skeletons and of both characters' motions.

The model factorises ``p(scales) p(first | scales) p(second | first, scales)`` (supplement, 2.3)
with one VAE per factor: ``SkeletonVae`` of bone scales (VAE1), and a ``CharacterVae`` each for the
first (VAE2) and the second character (VAE3). The networks of the latter are in ``models``.

References
----------
Kingma and Welling (2014), Auto-encoding variational Bayes.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor, nn

from pacmo_core.skeleton_prior.data import ExampleDataset
from pacmo_core.skeleton_prior.kinematics import KinematicOutput, mesh_root_shift
from pacmo_core.skeleton_prior.settings import PriorConfig

# Channels of the skeleton VAE, for which the supplement has no table.
SKELETON_HIDDEN, SKELETON_LATENT = 64, 16
# Decoded scales lie within 1 +- SCALE_RANGE, or RANGE_MARGIN times the largest deviation in the
# training data where that is larger, but always above 1 - MAX_SCALE_RANGE.
SCALE_RANGE, RANGE_MARGIN, MAX_SCALE_RANGE = 0.3, 1.2, 0.95
# Standard deviation of the Gaussian likelihood of a scale. With a larger one, samples vary less
# than the training data.
SCALE_STD = 3e-3
SKELETON_BATCH_SIZE, SKELETON_LEARNING_RATE = 64, 2e-3
# Metres: smallest root mean square of displacements that motions are normalised by.
MIN_DISPLACEMENT_SCALE = 1e-4


@dataclass(frozen=True)
class DiagonalGaussian:
    """Gaussian with diagonal covariance, such as the posterior q(z | x) of a VAE.

    Parameters
    ----------
    mean, log_variance : of one shape
    """

    mean: Tensor
    log_variance: Tensor

    def sample(self, random: torch.Generator) -> Tensor:
        """Sample by the reparameterisation ``z = mu + sigma * epsilon``, with gradients to both."""
        noise = torch.randn(self.mean.shape, generator=random).to(self.mean.device)
        return self.mean + noise * (0.5 * self.log_variance).exp()

    def kl_divergence(self) -> Tensor:
        """Return the KL divergence (Kullback-Leibler) from N(0, I), nats, mean over elements."""
        variance = self.log_variance.exp()
        # Kingma and Welling (2014), appendix B: 1/2 (mu^2 + sigma^2 - 1 - log sigma^2).
        return 0.5 * (self.mean.square() + variance - 1 - self.log_variance).mean()


class GaussianHead(nn.Module):
    """Output layers of an encoder: mean and log variance of the posterior.

    Unlike the supplement's tables, which have one dense layer where a VAE needs two.

    Parameters
    ----------
    in_channels, out_channels : int
    """

    def __init__(self, in_channels: int, out_channels: int) -> None:
        super().__init__()
        self.mean = nn.Linear(in_channels, out_channels)
        self.log_variance = nn.Linear(in_channels, out_channels)

    def forward(self, x: Tensor) -> DiagonalGaussian:
        """Map ``(..., C)`` to a Gaussian over ``(..., D)``."""
        return DiagonalGaussian(self.mean(x), self.log_variance(x).clamp(-10, 4))


class SkeletonVae(nn.Module):
    """VAE1, the prior of skeletons: two MLPs, J -> 64 -> 16 -> 64 -> J.

    Parameters
    ----------
    n_joints : including the root, whose scale is 1
    root : its index
    """

    scale_range: Tensor

    def __init__(self, n_joints: int, root: int) -> None:
        super().__init__()
        self.root = root
        self.register_buffer("scale_range", torch.tensor(SCALE_RANGE))
        self.encoder = nn.Linear(n_joints, SKELETON_HIDDEN)
        self.posterior = GaussianHead(SKELETON_HIDDEN, SKELETON_LATENT)
        self.decoder = nn.Sequential(
            nn.Linear(SKELETON_LATENT, SKELETON_HIDDEN),
            nn.ReLU(),
            nn.Linear(SKELETON_HIDDEN, n_joints),
        )

    def encode(self, scales: Tensor) -> DiagonalGaussian:
        """Compute the posterior over ``(B, 16)`` of scales (B, J)."""
        hidden = torch.relu(self.encoder((scales - 1) / self.scale_range))
        posterior: DiagonalGaussian = self.posterior(hidden)
        return posterior

    def decode(self, latent: Tensor) -> Tensor:
        """Decode latents (B, 16) to scales (B, J), all positive."""
        scales = 1 + self.scale_range * torch.tanh(self.decoder(latent))
        at_root = torch.arange(scales.shape[1], device=scales.device) == self.root
        return torch.where(at_root, 1.0, scales)

    def sample(self, n: int, random: torch.Generator) -> Tensor:
        """Sample the scales of n skeletons from the prior, (n, J)."""
        latent = torch.randn(n, SKELETON_LATENT, generator=random)
        return self.decode(latent.to(self.encoder.weight.device))


def fit_skeleton_vae(
    model: SkeletonVae, scales: Tensor, *, n_steps: int, random: torch.Generator
) -> None:
    """Train the skeleton VAE in place on the evidence lower bound (ELBO), then freeze it.

    It shares no weights with the motion VAEs, and needs more steps than these on a small dataset.

    Parameters
    ----------
    scales : (N, J)
    """
    largest = RANGE_MARGIN * (scales - 1).abs().max()
    model.scale_range.copy_(largest.clamp(SCALE_RANGE, MAX_SCALE_RANGE))
    optimiser = torch.optim.Adam(model.parameters(), lr=SKELETON_LEARNING_RATE)
    scheduler = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, n_steps)
    for _ in range(n_steps):
        rows = torch.randint(len(scales), (SKELETON_BATCH_SIZE,), generator=random)
        batch = scales[rows]
        posterior = model.encode(batch)
        errors = (model.decode(posterior.sample(random)) - batch) / SCALE_STD
        loss = 0.5 * errors.square().sum(dim=1).mean() + SKELETON_LATENT * posterior.kl_divergence()
        optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]  # torch leaves it untyped
        optimiser.step()
        scheduler.step()
    model.requires_grad_(False)


@dataclass(frozen=True)
class CharacterInputs:
    """Conditions of one character's motion.

    Parameters
    ----------
    template : (B, T, J, 3), metres: the character's source motion, at scale 1
    scales : (B, J), of its bones
    partner : (B, T, J, 3), metres: the partner's motion as far as it is known
    partner_template : (B, T, J, 3), metres
    partner_scales : (B, J)
    displacement_scale : metres, root mean square of displacements in the training data
    kinematics : KinematicOutput
    """

    template: Tensor
    scales: Tensor
    partner: Tensor
    partner_template: Tensor
    partner_scales: Tensor
    displacement_scale: Tensor
    kinematics: KinematicOutput

    def displacements(self, motion: Tensor) -> Tensor:
        """Normalise a motion's displacements from the template, (B, T, J, 3)."""
        return (motion - self.template) / self.displacement_scale

    @property
    def end_poses(self) -> Tensor:
        """``(B, J, 6)``: the first and the last pose of the template, metres."""
        return torch.cat([self.template[:, 0], self.template[:, -1]], dim=-1)

    @property
    def scale_offsets(self) -> Tensor:
        """``(B, T, J, 1)``: scales less 1, in every frame."""
        return self._at_every_frame(self.scales)

    @property
    def template_features(self) -> Tensor:
        """``(B, T, J, 4)``: the template 3 and the scales less 1."""
        return torch.cat([self.template, self.scale_offsets], dim=-1)

    @property
    def partner_features(self) -> Tensor:
        """``(B, T, J, 8)``: the partner 3, the template 3, and both characters' scales less 1."""
        scales = self._at_every_frame(self.partner_scales), self.scale_offsets
        return torch.cat([self.partner, self.template, *scales], dim=-1)

    @cached_property
    def initial_output(self) -> Tensor:
        """``(B, T, J, 3)``: output of the kinematic model before training."""
        change = self.partner - self.partner_template
        shift = mesh_root_shift(self.template, self.partner_template, change)
        return self.kinematics.initial_output(shift, self.template, self.scales)

    @cached_property
    def initial_motion(self) -> Tensor:
        """``(B, T, J, 3)``, metres: joint positions of the initial output."""
        motion: Tensor = self.kinematics(self.initial_output, self.template, self.scales)
        return motion

    def _at_every_frame(self, scales: Tensor) -> Tensor:
        return (scales - 1)[:, None, :, None].expand(-1, self.template.shape[1], -1, -1)


class CharacterVae(nn.Module, ABC):
    """VAE of one character's motion; ``output_layer`` maps decoder outputs to joint positions."""

    output_layer: nn.Module

    @abstractmethod
    def encode(
        self, motion: Tensor, inputs: CharacterInputs, random: torch.Generator | None
    ) -> DiagonalGaussian:
        """Encode a motion (B, T, J, 3), metres, as a posterior; ``random`` samples the dropout."""

    @abstractmethod
    def decode(self, latent: Tensor, inputs: CharacterInputs) -> Tensor:
        """Decode latents to the output layer's input ``(B, T, J, 3)``."""

    @abstractmethod
    def latent_shape(self, inputs: CharacterInputs) -> tuple[int, ...]:
        """Return the shape of the latents."""


@dataclass(frozen=True)
class Reconstruction:
    """Output of ``SkeletonPrior.reconstruct``.

    Parameters
    ----------
    motions : (B, T, 2, J, 3), metres, the first character first
    posteriors : of both characters
    """

    motions: Tensor
    posteriors: tuple[DiagonalGaussian, DiagonalGaussian]


class SkeletonPrior(nn.Module):
    """The three VAEs: ``p(scales) p(first | scales) p(second | first, scales)``.

    Parameters
    ----------
    config : PriorConfig
    characters : VAEs of the first and the second character
    symmetric : whether both VAEs take both characters' scales, so that training may swap the
        characters
    """

    displacement_scale: Tensor

    def __init__(
        self, config: PriorConfig, characters: tuple[CharacterVae, CharacterVae], *, symmetric: bool
    ) -> None:
        super().__init__()
        self.config, self.symmetric = config, symmetric
        self.skeleton_vae = SkeletonVae(len(config.skeleton.joints), config.skeleton.root)
        self.first, self.second = characters
        self.kinematics = KinematicOutput(config.skeleton, config.limbs)
        self.register_buffer("displacement_scale", torch.ones(()))

    def fit_displacement_scale(self, examples: ExampleDataset) -> None:
        """Set ``displacement_scale``, metres, to the root mean square over the data."""
        squares = [
            (variation - examples.templates[source]).square().mean()
            for variation, source in zip(
                examples.variations, examples.sources.tolist(), strict=True
            )
        ]
        scale = torch.stack(squares).mean().sqrt().clamp_min(MIN_DISPLACEMENT_SCALE)
        self.displacement_scale.copy_(scale)

    def reconstruct(
        self, template: Tensor, scales: Tensor, variation: Tensor, random: torch.Generator
    ) -> Reconstruction:
        """Encode and decode variations; the second VAE is conditioned on the true first motion.

        Parameters
        ----------
        template, variation : (B, T, 2, J, 3), metres
        scales : (B, 2, J)
        """
        inputs = self.first_inputs(template, scales)
        first_posterior = self.first.encode(variation[:, :, 0], inputs, random)
        first = self._motion(
            self.first, self.first.decode(first_posterior.sample(random), inputs), inputs
        )
        inputs = self.second_inputs(template, scales, variation[:, :, 0])
        second_posterior = self.second.encode(variation[:, :, 1], inputs, random)
        second = self._motion(
            self.second, self.second.decode(second_posterior.sample(random), inputs), inputs
        )
        motions = torch.stack([first, second], dim=2)
        return Reconstruction(motions, (first_posterior, second_posterior))

    def decode(
        self, template: Tensor, scales: Tensor, latents: tuple[Tensor, Tensor]
    ) -> tuple[Tensor, Tensor]:
        """Decode both characters, the second conditioned on the decoded first.

        Returns
        -------
        two decoder outputs (B, T, J, 3), for ``joint_positions``
        """
        inputs = self.first_inputs(template, scales)
        first = self.first.decode(latents[0], inputs)
        inputs = self.second_inputs(template, scales, self._motion(self.first, first, inputs))
        return first, self.second.decode(latents[1], inputs)

    def joint_positions(
        self, outputs: tuple[Tensor, Tensor], template: Tensor, scales: Tensor
    ) -> Tensor:
        """Compute both characters' joint positions, (B, T, 2, J, 3) metres, at any frame rate.

        Parameters
        ----------
        outputs : of both decoders, (B, T, J, 3)
        template : (B, T, 2, J, 3), metres
        scales : (B, 2, J)
        """
        first, second = (
            character.output_layer(output, template[:, :, role], scales[:, role])
            for role, (character, output) in enumerate(
                zip((self.first, self.second), outputs, strict=True)
            )
        )
        return torch.stack([first, second], dim=2)

    def sample_latents(
        self, template: Tensor, scales: Tensor, random: torch.Generator | None
    ) -> tuple[Tensor, Tensor]:
        """Sample both characters' latents from the prior N(0, I); its mean without a generator."""
        inputs = self.first_inputs(template, scales)
        first, second = (
            sample_prior(character.latent_shape(inputs), random).to(template.device)
            for character in (self.first, self.second)
        )
        return first, second

    def first_inputs(self, template: Tensor, scales: Tensor) -> CharacterInputs:
        """Build the inputs of the first character; its partner is estimated by IK."""
        partner = self.kinematics.ik_retarget(template[:, :, 1], scales[:, 1])
        return self._inputs(template, scales, partner, role=0)

    def second_inputs(self, template: Tensor, scales: Tensor, first: Tensor) -> CharacterInputs:
        """Build the inputs of the second character, whose partner is ``first`` (B, T, J, 3)."""
        return self._inputs(template, scales, first, role=1)

    def _inputs(
        self, template: Tensor, scales: Tensor, partner: Tensor, *, role: int
    ) -> CharacterInputs:
        other = 1 - role
        return CharacterInputs(
            template[:, :, role],
            scales[:, role],
            partner,
            template[:, :, other],
            scales[:, other],
            self.displacement_scale,
            self.kinematics,
        )

    def _motion(self, character: CharacterVae, output: Tensor, inputs: CharacterInputs) -> Tensor:
        motion: Tensor = character.output_layer(output, inputs.template, inputs.scales)
        return motion


def sample_prior(shape: tuple[int, ...], random: torch.Generator | None) -> Tensor:
    """Sample N(0, I); its mean without a generator."""
    return torch.zeros(shape) if random is None else torch.randn(shape, generator=random)
