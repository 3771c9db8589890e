"""One non-linear integral operator: a kernel in the Fourier domain, a pointwise map, GELU."""

import math

import torch
from torch import Tensor, nn
from torch.nn import functional

from pacmo_core.operators.fourier import analysis, resampling, resolved_modes, synthesis


class SpectralLayer(nn.Module):
    """Convolve a periodic function with a learned kernel and evaluate it on another grid.

    ``u(y) = sum_k R_k v_k exp(2 pi i k y)`` over the first M modes (Li et al. 2021; PaCMO, 2.2).
    The tensors are time first, so that each transform is one matrix product.

    Parameters
    ----------
    in_channels, out_channels : int
    n_in, n_out : points of the two grids, over the same period
    n_modes : M, cut down to what both grids resolve
    """

    analysis: Tensor
    synthesis: Tensor

    def __init__(
        self, *, in_channels: int, out_channels: int, n_in: int, n_out: int, n_modes: int
    ) -> None:
        super().__init__()
        self.n_modes = min(n_modes, resolved_modes(n_in), resolved_modes(n_out))
        phases = torch.arange(n_out, dtype=torch.float64) / n_out
        self.register_buffer("analysis", analysis(n_in, self.n_modes).float(), persistent=False)
        self.register_buffer("synthesis", synthesis(phases, self.n_modes).float(), persistent=False)
        # (mode, in, real | imaginary, out): one batched product serves both parts.
        self.weight = nn.Parameter(torch.zeros(self.n_modes, in_channels, 2, out_channels))

    def forward(self, v: Tensor) -> Tensor:
        """``(n_in, B, C_in)`` to ``(n_out, B, C_out)``."""
        batch, c_in, c_out = v.shape[1], v.shape[2], self.weight.shape[-1]
        coefficients = (self.analysis @ v.flatten(1)).view(self.n_modes, 2 * batch, c_in)
        products = torch.bmm(coefficients, self.weight.flatten(2))
        real, imaginary = products.view(self.n_modes, 2, batch, 2, c_out).unbind(1)
        mixed = torch.stack(
            [real[:, :, 0] - imaginary[:, :, 1], real[:, :, 1] + imaginary[:, :, 0]], dim=1
        )
        return (self.synthesis @ mixed.view(2 * self.n_modes, batch * c_out)).view(-1, batch, c_out)

    def initialise(self, random: torch.Generator) -> None:
        """Draw the weights from a complex normal law of variance ``1 / (2 C_in)``."""
        scale = math.sqrt(0.5 / (2 * self.weight.shape[1]))
        with torch.no_grad():
            self.weight.copy_(scale * torch.randn(self.weight.shape, generator=random))


class OperatorLayer(nn.Module):
    """``gelu(kernel operator + pointwise map)`` from one periodic grid to another (PaCMO, 2.2).

    Both branches change the grid in the Fourier domain, so that they speak of the same instants.
    """

    resampling: Tensor

    def __init__(
        self, *, in_channels: int, out_channels: int, n_in: int, n_out: int, n_modes: int
    ) -> None:
        super().__init__()
        self.spectral = SpectralLayer(
            in_channels=in_channels,
            out_channels=out_channels,
            n_in=n_in,
            n_out=n_out,
            n_modes=n_modes,
        )
        self.pointwise = nn.Linear(in_channels, out_channels)
        self.register_buffer("resampling", resampling(n_in, n_out).float(), persistent=False)

    def forward(self, v: Tensor) -> Tensor:
        """``(n_in, B, C_in)`` to ``(n_out, B, C_out)``."""
        n_out, n_in = self.resampling.shape
        if n_out <= n_in:  # the pointwise map is affine: do it where there are fewer points
            local = self.pointwise((self.resampling @ v.flatten(1)).view(n_out, *v.shape[1:]))
        else:
            local = self.pointwise(v)
            local = (self.resampling @ local.flatten(1)).view(n_out, *local.shape[1:])
        return functional.gelu(self.spectral(v) + local)
