"""VAE1, the prior of bone scales, and the Gaussian posteriors of all VAEs.

References
----------
Kingma and Welling (2014), Auto-encoding variational Bayes.
"""

from dataclasses import dataclass

import torch
from torch import Tensor, nn

# Channels, for which the supplement has no table.
HIDDEN, LATENT = 64, 16
# Decoded scales lie within 1 +- SCALE_RANGE, or RANGE_MARGIN times the largest deviation in the
# training data where that is larger, but always above 1 - MAX_SCALE_RANGE.
SCALE_RANGE, RANGE_MARGIN, MAX_SCALE_RANGE = 0.3, 1.2, 0.95
# Standard deviation of the Gaussian likelihood of a scale. With a larger one, samples vary less
# than the training data.
SCALE_STD = 3e-3
BATCH_SIZE, LEARNING_RATE = 64, 2e-3


@dataclass(frozen=True)
class DiagonalGaussian:
    """Gaussian with diagonal covariance, such as the posterior q(z | x) of a VAE."""

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
    """Train the skeleton VAE in place on the evidence lower bound (ELBO), then freeze it.

    It shares no weights with the motion VAEs, and needs more steps than these on a small dataset.

    Parameters
    ----------
    scales : (N, J)
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
