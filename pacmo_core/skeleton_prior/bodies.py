"""VAE1, the prior of bodies: scales of bones, from sixteen numbers."""

import torch
from torch import Tensor, nn

from pacmo_core.skeleton_prior.character import Code, Gaussian

HIDDEN, LATENT = 64, 16
# Scales lie within 1 +- this; the data's within 0.25.
REACH = 0.3


class Bodies(nn.Module):
    """MLP1 and MLP2, for which the supplement gives no table: n -> 64 -> 16 -> 64 -> n.

    Parameters
    ----------
    n_joints : with the root, whose scale is 1
    root : its index
    """

    def __init__(self, n_joints: int, root: int) -> None:
        super().__init__()
        self.root = root
        self.into = nn.Linear(n_joints, HIDDEN)
        self.code = Gaussian(HIDDEN, LATENT)
        self.out = nn.Sequential(nn.Linear(LATENT, HIDDEN), nn.ReLU(), nn.Linear(HIDDEN, n_joints))

    def encode(self, scales: Tensor) -> Code:
        """Encode (B, J)."""
        code: Code = self.code(torch.relu(self.into((scales - 1) / REACH)))
        return code

    def decode(self, latent: Tensor) -> Tensor:
        """Decode (B, 16) to scales (B, J), all of them positive."""
        scales = 1 + REACH * torch.tanh(self.out(latent))
        at_root = torch.arange(scales.shape[1], device=scales.device) == self.root
        return torch.where(at_root, 1.0, scales)

    def sample(self, n: int, random: torch.Generator) -> Tensor:
        """Draw n bodies, (n, J)."""
        latent = torch.randn(n, LATENT, generator=random)
        return self.decode(latent.to(self.into.weight.device))
