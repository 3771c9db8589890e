"""VAE1, the prior of bodies: scales of bones, from sixteen numbers."""

import torch
from torch import Tensor, nn

from pacmo_core.skeleton_prior.character import Code, Gaussian

HIDDEN, LATENT = 64, 16
# Scales lie within 1 +- this, or so many times as far as the data's; never as far as none.
REACH, BEYOND, MOST = 0.3, 1.2, 0.95
# To how much of their own length bones are to come back: less, and draws vary less than the data.
PRECISION = 3e-3
BATCH, LEARNING_RATE = 64, 2e-3


class Bodies(nn.Module):
    """MLP1 and MLP2, for which the supplement gives no table: n -> 64 -> 16 -> 64 -> n.

    Parameters
    ----------
    n_joints : with the root, whose scale is 1
    root : its index
    """

    reach: Tensor

    def __init__(self, n_joints: int, root: int) -> None:
        super().__init__()
        self.root = root
        self.register_buffer("reach", torch.tensor(REACH))
        self.into = nn.Linear(n_joints, HIDDEN)
        self.code = Gaussian(HIDDEN, LATENT)
        self.out = nn.Sequential(nn.Linear(LATENT, HIDDEN), nn.ReLU(), nn.Linear(HIDDEN, n_joints))

    def encode(self, scales: Tensor) -> Code:
        """Encode (B, J)."""
        code: Code = self.code(torch.relu(self.into((scales - 1) / self.reach)))
        return code

    def decode(self, latent: Tensor) -> Tensor:
        """Decode (B, 16) to scales (B, J), all of them positive."""
        scales = 1 + self.reach * torch.tanh(self.out(latent))
        at_root = torch.arange(scales.shape[1], device=scales.device) == self.root
        return torch.where(at_root, 1.0, scales)

    def sample(self, n: int, random: torch.Generator) -> Tensor:
        """Draw n bodies, (n, J)."""
        latent = torch.randn(n, LATENT, generator=random)
        return self.decode(latent.to(self.into.weight.device))


def learn(bodies: Bodies, scales: Tensor, *, n_steps: int, random: torch.Generator) -> None:
    """Learn the bodies of the data, in place, by the evidence lower bound; no more after that.

    By itself: it shares nothing with the characters, and in the few steps that a small set gives
    them its draws would stay what its weights began with.

    Parameters
    ----------
    scales : (N, J)
    """
    furthest = BEYOND * (scales - 1).abs().max()
    bodies.reach.copy_(furthest.clamp(REACH, MOST))
    optimiser = torch.optim.Adam(bodies.parameters(), lr=LEARNING_RATE)
    slower = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, n_steps)
    for _ in range(n_steps):
        batch = scales[torch.randint(len(scales), (BATCH,), generator=random)]
        code = bodies.encode(batch)
        errors = (bodies.decode(code.draw(random)) - batch) / PRECISION
        loss = 0.5 * errors.square().sum(dim=1).mean() + LATENT * code.divergence()
        optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]  # torch leaves it untyped
        optimiser.step()
        slower.step()
    bodies.requires_grad_(False)
