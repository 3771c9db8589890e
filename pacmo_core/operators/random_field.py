"""Gaussian random fields of time: coefficients are sampled once, values computed at any times."""

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from pacmo_core.data.limits import MAX_GRID


@dataclass(frozen=True)
class GaussianRandomField:
    """A periodic Gaussian process of unit variance and zero mean.

    Its covariance is proportional to ``(-Laplacian + tau^2)^(-alpha)``, cut off after K
    frequencies: ``cov(s, t) = sum_k p_k cos(2 pi k (s - t) / period)`` for k from 0, with ``p_k``
    proportional to ``((2 pi k / period)^2 + tau^2)^(-alpha)``, half of it at k = 0, and of sum one.
    The constant part matters: by its sign alone a generator chooses, for all of a motion, with
    which hand or foot to act, where otherwise it averages the two.

    Parameters
    ----------
    alpha : smoothness; the field is Matern-like with nu = alpha - 1/2
    tau : inverse length
    n_frequencies : K, the constant part among them
    period : longer than 1, or the two ends of [0, 1] would be tied together
    """

    alpha: float
    tau: float
    n_frequencies: int
    period: float

    def __post_init__(self) -> None:
        if not (0 < self.n_frequencies <= MAX_GRID and self.period > 0):
            raise ValueError(
                f"n_frequencies must be 1 to {MAX_GRID}, period > 0; "
                f"got {self.n_frequencies}, {self.period}"
            )

    def power(self) -> Tensor:
        """``(K,)`` float64: the variance p_k that each frequency carries."""
        frequency = 2 * math.pi * torch.arange(self.n_frequencies, dtype=torch.float64)
        power = ((frequency / self.period) ** 2 + self.tau**2) ** -self.alpha
        power[0] /= 2  # a frequency k > 0 stands for k and -k
        return power / power.sum()

    def sample(self, *shape: int, random: torch.Generator) -> Tensor:
        """Sample the coefficients of independent fields, on the generator's device.

        Returns
        -------
        (*shape, 2 K) float32
        """
        size = (*shape, 2 * self.n_frequencies)
        normal = torch.randn(size, generator=random, device=random.device)
        return normal * self.power().sqrt().repeat_interleave(2).float().to(normal.device)

    def basis(self, times: Tensor) -> Tensor:
        """``(T, 2 K)`` float32: cosine and sine of each frequency at ``(T,)`` times."""
        order = torch.arange(self.n_frequencies, dtype=torch.float64, device=times.device)
        angle = 2 * math.pi / self.period * torch.outer(times.double(), order)
        return torch.stack([angle.cos(), angle.sin()], dim=-1).flatten(1).float()

    def evaluate(self, coefficients: Tensor, times: Tensor) -> Tensor:
        """Evaluate ``(B, C, 2 K)`` coefficients at ``(T,)`` times: ``(B, T, C)``."""
        return (coefficients @ self.basis(times).T).transpose(1, 2)

    def shift(self, coefficients: Tensor, by: float) -> Tensor:
        """Shift the origin of time: the new field at ``t`` is the old one at ``t + by``.

        Exact; the distribution does not change, for the field is stationary.
        """
        order = torch.arange(self.n_frequencies, dtype=torch.float64)
        angle = 2 * math.pi / self.period * by * order
        cos, sin = (part.float().to(coefficients.device) for part in (angle.cos(), angle.sin()))
        a, b = coefficients[..., ::2], coefficients[..., 1::2]
        return torch.stack([a * cos + b * sin, b * cos - a * sin], dim=-1).flatten(-2)
