"""The model of the paper: ``p(scales) p(first | scales) p(second | first, scales)``.

One VAE each (supplement, 2.3): ``SkeletonVae`` of bone scales (VAE1), and a ``CharacterVae`` for
the first (VAE2) and the second character (VAE3).

References
----------
Kingma and Welling (2014), Auto-encoding variational Bayes.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import torch
from torch import Tensor, nn

from pacmo_core.skeleton_prior.data import ExampleDataset
from pacmo_core.skeleton_prior.settings import PriorConfig
from pacmo_core.skeleton_prior.start import squared_distances

# Channels, for which the supplement has no table.
HIDDEN, LATENT = 64, 16
# Decoded scales lie within 1 +- SCALE_RANGE, or RANGE_MARGIN times the largest deviation in the
# training data where that is larger, but always above 1 - MAX_SCALE_RANGE.
SCALE_RANGE, RANGE_MARGIN, MAX_SCALE_RANGE = 0.3, 1.2, 0.95
# Standard deviation of the Gaussian likelihood of a scale. With a larger one, samples vary less
# than the training data.
SCALE_STD = 3e-3
BATCH_SIZE, LEARNING_RATE = 64, 2e-3
# Metres: smallest root mean square of displacements that motions are normalised by.
MIN_DISPLACEMENT_SCALE = 1e-4
# Smallest change of the skeletons that features and outputs are normalised by.
MIN_SCALE_CHANGE = 1e-3


@dataclass(frozen=True)
class DiagonalGaussian:
    """Gaussian with diagonal covariance: the posterior q(z | x) of a VAE."""

    mean: Tensor
    log_variance: Tensor

    @classmethod
    def from_output(cls, output: Tensor, dim: int = -1) -> "DiagonalGaussian":
        """Split an encoder's output into mean and log variance along an axis."""
        mean, log_variance = output.chunk(2, dim)
        return cls(mean, log_variance.clamp(-10, 4))

    def sample(self, random: torch.Generator) -> Tensor:
        """Sample by the reparameterisation ``z = mu + sigma * epsilon``, with gradients to both."""
        noise = torch.randn(self.mean.shape, generator=random).to(self.mean.device)
        return self.mean + noise * (0.5 * self.log_variance).exp()

    def kl_divergence(self) -> Tensor:
        """Return the KL divergence (Kullback-Leibler) from N(0, I), nats, mean over elements."""
        variance = self.log_variance.exp()
        # Kingma and Welling (2014), appendix B: 1/2 (mu^2 + sigma^2 - 1 - log sigma^2).
        return 0.5 * (self.mean.square() + variance - 1 - self.log_variance).mean()


class SkeletonVae(nn.Module):
    """VAE1, the prior of skeletons: two MLPs, J -> 64 -> 16 -> 64 -> J; the root's scale is 1."""

    scale_range: Tensor

    def __init__(self, n_joints: int, root: int) -> None:
        super().__init__()
        self.root = root
        self.register_buffer("scale_range", torch.tensor(SCALE_RANGE))
        self.encoder = nn.Sequential(
            nn.Linear(n_joints, HIDDEN), nn.ReLU(), nn.Linear(HIDDEN, 2 * LATENT)
        )
        self.decoder = nn.Sequential(
            nn.Linear(LATENT, HIDDEN), nn.ReLU(), nn.Linear(HIDDEN, n_joints)
        )

    def encode(self, scales: Tensor) -> DiagonalGaussian:
        """Compute the posterior over ``(B, 16)`` of scales (B, J)."""
        return DiagonalGaussian.from_output(self.encoder((scales - 1) / self.scale_range))

    def decode(self, latent: Tensor) -> Tensor:
        """Decode latents (B, 16) to scales (B, J), all positive."""
        scales = 1 + self.scale_range * torch.tanh(self.decoder(latent))
        at_root = torch.arange(scales.shape[1], device=scales.device) == self.root
        return torch.where(at_root, 1.0, scales)

    def sample(self, n: int, random: torch.Generator) -> Tensor:
        """Sample the scales of n skeletons from the prior, (n, J)."""
        latent = torch.randn(n, LATENT, generator=random)
        return self.decode(latent.to(self.scale_range.device))


def fit_skeleton_vae(
    model: SkeletonVae, scales: Tensor, *, n_steps: int, random: torch.Generator
) -> None:
    """Train the skeleton VAE in place on scales (N, J), then freeze it.

    The loss is the evidence lower bound (ELBO). It shares no weights with the motion VAEs, and
    needs more steps than these on a small dataset.
    """
    largest = RANGE_MARGIN * (scales - 1).abs().max()
    model.scale_range.copy_(largest.clamp(SCALE_RANGE, MAX_SCALE_RANGE))
    optimiser = torch.optim.Adam(model.parameters(), lr=LEARNING_RATE)
    scheduler = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, n_steps)
    for _ in range(n_steps):
        batch = scales[torch.randint(len(scales), (BATCH_SIZE,), generator=random)]
        posterior = model.encode(batch)
        errors = (model.decode(posterior.sample(random)) - batch) / SCALE_STD
        loss = 0.5 * errors.square().sum(dim=1).mean() + LATENT * posterior.kl_divergence()
        optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]  # torch leaves it untyped
        optimiser.step()
        scheduler.step()
    model.requires_grad_(False)


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


class CharacterVae(nn.Module, ABC):
    """VAE of one character's motion, whose output is a displacement from the template."""

    has_exact_bones = False  # whether bones get their lengths whatever the output
    symmetric = False  # whether both characters' VAEs take both bodies' scales: they can be swapped

    def compute_condition(self, inputs: CharacterInputs) -> Any:
        """Compute what encoder and decoder are both given: here the inputs as they are."""
        return inputs

    @abstractmethod
    def encode(self, motion: Tensor, given: Any) -> DiagonalGaussian:
        """Encode a motion (B, T, J, 3), metres, as a posterior, given the condition."""

    @abstractmethod
    def decode(self, latent: Tensor, given: Any) -> Tensor:
        """Decode latents to the output ``(B, T, J, 3)``, given the condition."""

    @abstractmethod
    def latent_shape(self, template: Tensor) -> tuple[int, ...]:
        """Return the shape of the latents for templates (B, T, J, 3)."""

    def expected_partner(self, template: Tensor, scales: Tensor) -> Tensor:
        """Guess the motion of a partner that is not decoded yet: here its template."""
        del scales
        return template

    def joint_positions(self, output: Tensor, template: Tensor, scales: Tensor) -> Tensor:
        """Compute joint positions, (B, T, J, 3) metres, of an output, at any frame rate."""
        del scales
        return template + output


class SkeletonPrior(nn.Module):
    """The three VAEs; motions are (B, T, 2, J, 3) metres, the first character first."""

    displacement_scale: Tensor

    def __init__(self, config: PriorConfig, first: CharacterVae, second: CharacterVae) -> None:
        super().__init__()
        self.config = config
        self.skeleton_vae = SkeletonVae(len(config.skeleton.joints), config.skeleton.root)
        self.first, self.second = first, second
        self.register_buffer("displacement_scale", torch.ones(()))

    def fit_displacement_scale(self, examples: ExampleDataset) -> None:
        """Set ``displacement_scale``, metres, to the root mean square over the data."""
        pairs = zip(examples.variations, examples.sources.tolist(), strict=True)
        squares = [
            (variation - examples.templates[source]).square().mean() for variation, source in pairs
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
    ) -> tuple[Tensor, tuple[DiagonalGaussian, DiagonalGaussian]]:
        """Encode and decode variations; return motions and the posteriors of both characters.

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

        true_first, true_second = variation.unbind(dim=2)
        given = self.first_condition(template, scales)
        first = self.first.encode(true_first, given)
        output = self.first.decode(latent(first), given)
        motion = self.first.joint_positions(output, template[:, :, 0], scales[:, 0])
        known = torch.where(as_used[:, None, None, None], motion.detach(), true_first)
        given = self.second_condition(template, scales, known)
        second = self.second.encode(true_second, given)
        output = self.second.decode(latent(second), given)
        partner = self.second.joint_positions(output, template[:, :, 1], scales[:, 1])
        return torch.stack([motion, partner], dim=2), (first, second)

    def decode(
        self,
        template: Tensor,
        scales: Tensor,
        random: torch.Generator | None,
        temperature: float = 1.0,
    ) -> tuple[Tensor, Tensor]:
        """Decode latents from the prior N(0, temperature² I), without a generator its mean.

        Returns
        -------
        both characters' outputs (B, T, J, 3), the second's given the decoded first
        """

        def latent(vae: CharacterVae) -> Tensor:
            shape = vae.latent_shape(template[:, :, 0])
            if random is None:
                return torch.zeros(shape, device=template.device)
            return temperature * torch.randn(shape, generator=random).to(template.device)

        output = self.first.decode(latent(self.first), self.first_condition(template, scales))
        motion = self.first.joint_positions(output, template[:, :, 0], scales[:, 0])
        given = self.second_condition(template, scales, motion)
        return output, self.second.decode(latent(self.second), given)

    def joint_positions(
        self, outputs: tuple[Tensor, Tensor], template: Tensor, scales: Tensor
    ) -> Tensor:
        """Compute joint positions, (B, T, 2, J, 3) metres, of ``decode``'s at any frame rate."""
        first = self.first.joint_positions(outputs[0], template[:, :, 0], scales[:, 0])
        second = self.second.joint_positions(outputs[1], template[:, :, 1], scales[:, 1])
        return torch.stack([first, second], dim=2)

    def first_condition(self, template: Tensor, scales: Tensor) -> Any:
        """Compute the condition of the first character: its partner's motion is a guess."""
        partner = self.first.expected_partner(template[:, :, 1], scales[:, 1])
        return self.first.compute_condition(self._inputs(template, scales, partner, role=0))

    def second_condition(self, template: Tensor, scales: Tensor, first: Tensor) -> Any:
        """Compute the condition of the second character, whose partner is ``first``."""
        return self.second.compute_condition(self._inputs(template, scales, first, role=1))

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
