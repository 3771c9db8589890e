"""Fourier analysis and synthesis as real matrices, so that they cost one matrix product.

A function of period 1 with ``M`` modes stands as ``2 M`` rows: the real and the imaginary part of
each coefficient in turn, normalised so that they do not depend on the size of the grid.
"""

import math

import torch
from torch import Tensor


def resolved_modes(n_points: int) -> int:
    """Count the modes that a periodic grid tells apart, without Nyquist's, which has no phase."""
    return (n_points + 1) // 2


def analysis(n_points: int, n_modes: int) -> Tensor:
    """Build the matrix ``(2 M, N)`` from values on a periodic grid to coefficients, float64.

    Raises
    ------
    ValueError
        If the grid does not resolve so many modes.
    """
    if n_modes > resolved_modes(n_points):
        raise ValueError(
            f"{n_points} points resolve {resolved_modes(n_points)} modes; wanted {n_modes}"
        )
    angle = _angles(torch.arange(n_points, dtype=torch.float64) / n_points, n_modes)
    pairs = torch.stack([angle.cos(), -angle.sin()], dim=-1) / n_points
    return pairs.reshape(n_points, 2 * n_modes).T.contiguous()


def synthesis(phases: Tensor, n_modes: int) -> Tensor:
    """Build the matrix ``(T, 2 M)`` from coefficients to values, float64.

    Parameters
    ----------
    phases : (T,), instants in periods
    n_modes : M, the constant mode among them
    """
    angle = _angles(phases.double(), n_modes)
    pairs = torch.stack([angle.cos(), -angle.sin()], dim=-1)
    pairs[:, 1:] *= 2  # a real function's coefficients of negative frequency are conjugates
    return pairs.reshape(len(phases), 2 * n_modes)


def resampling(n_in: int, n_out: int) -> Tensor:
    """Build the matrix ``(n_out, n_in)`` between periodic grids; keep all that both resolve."""
    n_modes = min(resolved_modes(n_in), resolved_modes(n_out))
    phases = torch.arange(n_out, dtype=torch.float64) / n_out
    return synthesis(phases, n_modes) @ analysis(n_in, n_modes)


def interpolation(phases: Tensor, n_points: int) -> Tensor:
    """Build the matrix ``(T, N)`` from values on a periodic grid to values at any instants."""
    n_modes = resolved_modes(n_points)
    return synthesis(phases.cpu(), n_modes) @ analysis(n_points, n_modes)


def periodic_extension(n_points: int, n_latent: int) -> Tensor:
    """Build the matrix ``(L, N)`` that closes a function on [0, 1] into one of period L / (N - 1).

    The first N points of the latent grid are the function's own; the rest is the cubic that joins
    value and slope at its end to those at its beginning. A jump there would ring through every
    later layer, and ring otherwise at another resolution.
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
