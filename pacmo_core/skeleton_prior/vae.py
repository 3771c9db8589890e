"""The model of the paper: ``p(scales) p(first | scales) p(second | first, scales)``.

One VAE each (supplement, 2.3): ``SkeletonVae`` of bone scales (VAE1), and a ``CharacterVae`` for
the first (VAE2) and the second character (VAE3).
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor, nn

from pacmo_core.skeleton_prior.data import ExampleDataset
from pacmo_core.skeleton_prior.settings import PriorConfig
from pacmo_core.skeleton_prior.skeleton_vae import DiagonalGaussian, SkeletonVae
from pacmo_core.skeleton_prior.start import squared_distances

# Metres: smallest root mean square of displacements that motions are normalised by.
MIN_DISPLACEMENT_SCALE = 1e-4
# Smallest change of the skeletons that features and outputs are normalised by.
MIN_SCALE_CHANGE = 1e-3


@dataclass(frozen=True)
class CharacterInputs:
    """Conditions of one character's motion; motions (B, T, J, 3) metres, scales (B, J)."""

    template: Tensor  # the character's source motion, at scale 1
    scales: Tensor  # of its bones
    partner: Tensor  # the partner's motion as far as it is known
    partner_template: Tensor
    partner_scales: Tensor
    displacement_scale: Tensor  # metres, root mean square of displacements in the training data
    partner_yields: bool  # whether the partner's motion is a guess, as for the first character

    def displacements(self, motion: Tensor) -> Tensor:
        """Normalise a motion's displacements from the template, (B, 3, T, J)."""
        return channels_first((motion - self.template) / self.displacement_scale)

    @cached_property
    def squared_distances(self) -> Tensor:
        """``(B, T, J, J)``: between the joints of both templates, square metres."""
        return squared_distances(self.template, self.partner_template)

    @property
    def scale_change(self) -> Tensor:
        """Root mean square log scale of both characters, ``(B, 1, 1, 1)``."""
        both = torch.cat([self.scales, self.partner_scales], dim=1)
        size = both.log().square().mean(dim=1).sqrt()
        return size.clamp_min(MIN_SCALE_CHANGE)[:, None, None, None]

    @property
    def end_poses(self) -> Tensor:
        """``(B, J, 6)``: the first and the last pose of the template, metres."""
        return torch.cat([self.template[:, 0], self.template[:, -1]], dim=-1)

    @property
    def scale_offsets(self) -> Tensor:
        """``(B, 1, T, J)``: scales less 1, in every frame."""
        return self._at_every_frame(self.scales)

    @property
    def template_features(self) -> Tensor:
        """``(B, 4, T, J)``: the template 3 and the scales less 1."""
        return torch.cat([channels_first(self.template), self.scale_offsets], dim=1)

    @property
    def partner_features(self) -> Tensor:
        """``(B, 8, T, J)``: the partner 3, the template 3, and both characters' scales less 1."""
        positions = channels_first(self.partner), channels_first(self.template)
        scales = self._at_every_frame(self.partner_scales), self.scale_offsets
        return torch.cat([*positions, *scales], dim=1)

    def _at_every_frame(self, scales: Tensor) -> Tensor:
        return (scales - 1)[:, None, None].expand(-1, -1, self.template.shape[1], -1)


def channels_first(x: Tensor) -> Tensor:
    """Map ``(B, T, J, C)`` to ``(B, C, T, J)``."""
    return x.permute(0, 3, 1, 2)


class CharacterVae(nn.Module, ABC):
    """VAE of one character's motion; ``output_layer`` maps decoder outputs to joint positions."""

    output_layer: nn.Module
    has_exact_bones = False  # whether the output layer gives bones their lengths

    @abstractmethod
    def encode(self, motion: Tensor, inputs: CharacterInputs) -> DiagonalGaussian:
        """Encode a motion (B, T, J, 3), metres, as a posterior."""

    @abstractmethod
    def decode(self, latent: Tensor, inputs: CharacterInputs) -> Tensor:
        """Decode latents to the output layer's input ``(B, T, J, 3)``."""

    @abstractmethod
    def latent_shape(self, inputs: CharacterInputs) -> tuple[int, ...]:
        """Return the shape of the latents."""

    def expected_partner(self, template: Tensor, scales: Tensor) -> Tensor:
        """Guess the motion of a partner that is not decoded yet: here its template."""
        del scales
        return template

    def reconstruct(
        self, motion: Tensor, inputs: CharacterInputs, sample: Callable[[DiagonalGaussian], Tensor]
    ) -> tuple[Tensor, DiagonalGaussian]:
        """Encode a motion, and decode a latent that ``sample`` takes from the posterior."""
        posterior = self.encode(motion, inputs)
        return self.motion(sample(posterior), inputs), posterior

    def motion(self, latent: Tensor, inputs: CharacterInputs) -> Tensor:
        """Decode latents to joint positions ``(B, T, J, 3)``, metres."""
        output = self.decode(latent, inputs)
        motion: Tensor = self.output_layer(output, inputs.template, inputs.scales)
        return motion


@dataclass(frozen=True)
class Reconstruction:
    """Output of ``SkeletonPrior.reconstruct``."""

    motions: Tensor  # (B, T, 2, J, 3), metres, the first character first
    posteriors: tuple[DiagonalGaussian, DiagonalGaussian]


class SkeletonPrior(nn.Module):
    """The three VAEs; ``symmetric`` if both of the characters' take both bodies' scales.

    Training may swap the characters of a symmetric model.
    """

    displacement_scale: Tensor

    def __init__(
        self, config: PriorConfig, characters: tuple[CharacterVae, CharacterVae], *, symmetric: bool
    ) -> None:
        super().__init__()
        self.config, self.symmetric = config, symmetric
        self.skeleton_vae = SkeletonVae(len(config.skeleton.joints), config.skeleton.root)
        self.first, self.second = characters
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
        self,
        template: Tensor,
        scales: Tensor,
        variation: Tensor,
        as_used: Tensor,
        random: torch.Generator,
    ) -> Reconstruction:
        """Encode and decode variations.

        The second VAE is conditioned on the true first motion. Rows ``as_used`` are decoded as
        without the variation: from the latents' prior mean, the second given the decoded first.

        Parameters
        ----------
        template, variation : (B, T, 2, J, 3), metres
        scales : (B, 2, J)
        as_used : (B,) bool
        """

        def latent(posterior: DiagonalGaussian) -> Tensor:
            sample = posterior.sample(random)
            return sample * ~as_used.view(-1, *[1] * (sample.ndim - 1))

        first, second = variation.unbind(dim=2)
        inputs = self.first_inputs(template, scales)
        motion, posterior = self.first.reconstruct(first, inputs, latent)
        known = torch.where(as_used[:, None, None, None], motion.detach(), first)
        inputs = self.second_inputs(template, scales, known)
        second_motion, second_posterior = self.second.reconstruct(second, inputs, latent)
        motions, posteriors = (motion, second_motion), (posterior, second_posterior)
        return Reconstruction(torch.stack(motions, dim=2), posteriors)

    def decode(
        self, template: Tensor, scales: Tensor, latents: tuple[Tensor, Tensor]
    ) -> tuple[Tensor, Tensor]:
        """Decode both characters' outputs (B, T, J, 3), the second's given the decoded first."""
        inputs = self.first_inputs(template, scales)
        first = self.first.decode(latents[0], inputs)
        motion = self.first.output_layer(first, inputs.template, inputs.scales)
        return first, self.second.decode(latents[1], self.second_inputs(template, scales, motion))

    def joint_positions(
        self, outputs: tuple[Tensor, Tensor], template: Tensor, scales: Tensor
    ) -> Tensor:
        """Compute joint positions, (B, T, 2, J, 3) metres, of ``decode``'s at any frame rate."""
        first = self.first.output_layer(outputs[0], template[:, :, 0], scales[:, 0])
        second = self.second.output_layer(outputs[1], template[:, :, 1], scales[:, 1])
        return torch.stack([first, second], dim=2)

    def sample_latents(
        self, template: Tensor, scales: Tensor, random: torch.Generator | None
    ) -> tuple[Tensor, Tensor]:
        """Sample both characters' latents from the prior N(0, I); its mean without a generator."""
        inputs = self.first_inputs(template, scales)
        shapes = self.first.latent_shape(inputs), self.second.latent_shape(inputs)
        first, second = (
            torch.zeros(shape) if random is None else torch.randn(shape, generator=random)
            for shape in shapes
        )
        return first.to(template.device), second.to(template.device)

    def first_inputs(self, template: Tensor, scales: Tensor) -> CharacterInputs:
        """Build the inputs of the first character, whose partner's motion is not known yet."""
        partner = self.first.expected_partner(template[:, :, 1], scales[:, 1])
        return self._inputs(template, scales, partner, role=0)

    def second_inputs(self, template: Tensor, scales: Tensor, first: Tensor) -> CharacterInputs:
        """Build the inputs of the second character, whose partner is ``first`` (B, T, J, 3)."""
        return self._inputs(template, scales, first, role=1)

    def _inputs(
        self, template: Tensor, scales: Tensor, partner: Tensor, *, role: int
    ) -> CharacterInputs:
        return CharacterInputs(
            template[:, :, role],
            scales[:, role],
            partner,
            template[:, :, 1 - role],
            scales[:, 1 - role],
            self.displacement_scale,
            partner_yields=role == 0,
        )
