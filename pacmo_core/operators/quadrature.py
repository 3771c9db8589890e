"""Integrals of sampled functions: the trapezoidal rule, and a learned linear functional."""

import torch
from torch import Tensor, nn


def trapezoid_weights(times: Tensor) -> Tensor:
    """Return weights with which ``(weights * v).sum()`` integrates the piecewise linear function.

    Parameters
    ----------
    times : (..., T), strictly increasing, T >= 2

    Returns
    -------
    (..., T), in the unit of ``times``; they sum to the length of the interval

    Raises
    ------
    ValueError
        If there are fewer than two times, or they do not increase.
    """
    if times.shape[-1] < 2:
        raise ValueError(f"times must be at least two; got {times.shape[-1]}")
    gaps = times.diff(dim=-1)
    if bool((gaps <= 0).any()):
        raise ValueError(f"times must increase strictly; got a gap of {gaps.min().item():g}")
    zero = torch.zeros_like(gaps[..., :1])
    return (torch.cat([gaps, zero], dim=-1) + torch.cat([zero, gaps], dim=-1)) / 2


class FunctionalLayer(nn.Module):
    """``r = integral kappa(t) v(t) dt``, kappa a small network of time (PaCMO, 3.2).

    Parameters
    ----------
    hidden : units of each of the two hidden layers of kappa
    """

    def __init__(self, *, hidden: int) -> None:
        super().__init__()
        self.kernel = nn.Sequential(
            nn.Linear(1, hidden),
            nn.GELU(),
            nn.Linear(hidden, hidden),
            nn.GELU(),
            nn.Linear(hidden, 1, bias=False),
        )

    def forward(self, v: Tensor, times: Tensor) -> Tensor:
        """Integrate ``(B, T)`` values at ``(T,)`` times: ``(B,)``."""
        # An integral is a long sum: in single precision, whatever the networks around it run in.
        with torch.autocast(v.device.type, enabled=False):
            kappa: Tensor = self.kernel(times[:, None])[:, 0]
            return torch.mv(v.to(kappa.dtype), trapezoid_weights(times) * kappa)
