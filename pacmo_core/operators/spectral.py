"""Fourier analysis and synthesis as matrices, and the integral operator layer made of them.

A function of period 1 with ``M`` modes is represented by ``2 M`` rows: the real and the imaginary
part of each coefficient in turn, normalised so that they do not depend on the size of the grid.
"""

import math

import torch
from torch import Tensor, nn
from torch.nn import functional


def n_resolved_modes(n_points: int) -> int:
    """Return the number of modes that a periodic grid resolves, without Nyquist's, of no phase."""
    return (n_points + 1) // 2


def analysis_matrix(n_points: int, n_modes: int) -> Tensor:
    """Build the matrix ``(2 M, N)`` from values on a periodic grid to coefficients, float64.

    Raises
    ------
    ValueError
        If the grid does not resolve so many modes.
    """
    if n_modes > n_resolved_modes(n_points):
        raise ValueError(
            f"{n_points} points resolve {n_resolved_modes(n_points)} modes; got n_modes {n_modes}"
        )
    angle = _angles(torch.arange(n_points, dtype=torch.float64) / n_points, n_modes)
    pairs = torch.stack([angle.cos(), -angle.sin()], dim=-1) / n_points
    return pairs.reshape(n_points, 2 * n_modes).T.contiguous()


def synthesis_matrix(phases: Tensor, n_modes: int) -> Tensor:
    """Build the matrix ``(T, 2 M)`` from coefficients to values, float64.

    Parameters
    ----------
    phases : (T,), times in periods
    n_modes : M, including the constant mode
    """
    angle = _angles(phases.double(), n_modes)
    pairs = torch.stack([angle.cos(), -angle.sin()], dim=-1)
    pairs[:, 1:] *= 2  # a real function's coefficients of negative frequency are conjugates
    return pairs.reshape(len(phases), 2 * n_modes)


def resampling_matrix(n_in: int, n_out: int) -> Tensor:
    """Build the matrix ``(n_out, n_in)`` between periodic grids, of the modes that both resolve."""
    n_modes = min(n_resolved_modes(n_in), n_resolved_modes(n_out))
    phases = torch.arange(n_out, dtype=torch.float64) / n_out
    return synthesis_matrix(phases, n_modes) @ analysis_matrix(n_in, n_modes)


def interpolation_matrix(phases: Tensor, n_points: int) -> Tensor:
    """Build the matrix ``(T, N)`` from values on a periodic grid to values at any times."""
    n_modes = n_resolved_modes(n_points)
    return synthesis_matrix(phases.cpu(), n_modes) @ analysis_matrix(n_points, n_modes)


def periodic_extension_matrix(n_points: int, n_latent: int) -> Tensor:
    """Build the matrix ``(L, N)`` that closes a function on [0, 1] into one of period L / (N - 1).

    The first N points of the latent grid are those of the function; the rest is the cubic Hermite
    interpolation from value and slope at its end to those at its beginning. A discontinuity would
    cause ringing in every layer, different at each resolution.
    """
    step = 1 / (n_points - 1)
    gap = (n_latent - n_points + 1) * step
    s = torch.arange(1, n_latent - n_points + 1, dtype=torch.float64) * step / gap
    matrix = torch.zeros(n_latent, n_points, dtype=torch.float64)
    matrix[:n_points] = torch.eye(n_points, dtype=torch.float64)
    slope = torch.tensor([-1.5, 2.0, -0.5], dtype=torch.float64) / step
    rest = matrix[n_points:]
    rest[:, -1] += 2 * s**3 - 3 * s**2 + 1
    rest[:, 0] += 3 * s**2 - 2 * s**3
    rest[:, -3:] += gap * torch.outer(s**3 - 2 * s**2 + s, -slope.flip(0))
    rest[:, :3] += gap * torch.outer(s**3 - s**2, slope)
    return matrix


def _angles(phases: Tensor, n_modes: int) -> Tensor:
    return 2 * math.pi * torch.outer(phases, torch.arange(n_modes, dtype=torch.float64))


class SpectralLayer(nn.Module):
    """Spectral convolution of a periodic function with a learned kernel, on another grid.

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
        self.n_modes = min(n_modes, n_resolved_modes(n_in), n_resolved_modes(n_out))
        phases = torch.arange(n_out, dtype=torch.float64) / n_out
        self.register_buffer(
            "analysis", analysis_matrix(n_in, self.n_modes).float(), persistent=False
        )
        self.register_buffer(
            "synthesis", synthesis_matrix(phases, self.n_modes).float(), persistent=False
        )
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
        """Sample the weights from a complex normal distribution of variance ``1 / (2 C_in)``."""
        scale = math.sqrt(0.5 / (2 * self.weight.shape[1]))
        with torch.no_grad():
            self.weight.copy_(scale * torch.randn(self.weight.shape, generator=random))


class OperatorLayer(nn.Module):
    """``gelu(kernel operator + pointwise map)`` from one periodic grid to another (PaCMO, 2.2).

    Both branches change the grid in the Fourier domain, so that they refer to the same times.
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
        self.register_buffer("resampling", resampling_matrix(n_in, n_out).float(), persistent=False)

    def forward(self, v: Tensor) -> Tensor:
        """``(n_in, B, C_in)`` to ``(n_out, B, C_out)``."""
        n_out, n_in = self.resampling.shape
        if n_out <= n_in:  # the pointwise map is affine: do it where there are fewer points
            local = self.pointwise((self.resampling @ v.flatten(1)).view(n_out, *v.shape[1:]))
        else:
            local = self.pointwise(v)
            local = (self.resampling @ local.flatten(1)).view(n_out, *local.shape[1:])
        return functional.gelu(self.spectral(v) + local)


def initialise_weights(module: nn.Module, random: torch.Generator) -> None:
    """Initialise all weights of ``module`` in order from an explicit random generator.

    The distributions are those of torch's layers, whose constructors use a global generator.

    Raises
    ------
    ValueError
        If a layer with weights is of a type without a rule here.
    """
    for layer in module.modules():
        if isinstance(layer, SpectralLayer):
            layer.initialise(random)
        elif isinstance(layer, nn.Linear):
            _uniform(layer, 1 / math.sqrt(layer.in_features), random)
        elif isinstance(layer, nn.GRU):
            _uniform(layer, 1 / math.sqrt(layer.hidden_size), random)
        elif next(layer.parameters(recurse=False), None) is not None:
            raise ValueError(f"no rule to initialise the weights of {type(layer).__name__}")


def _uniform(layer: nn.Module, bound: float, random: torch.Generator) -> None:
    with torch.no_grad():
        for weight in layer.parameters(recurse=False):
            weight.copy_(torch.empty(weight.shape).uniform_(-bound, bound, generator=random))
