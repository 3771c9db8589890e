"""Weights that turn samples of a function of time into integrals."""

import torch
from torch import Tensor


def trapezoid_weights(times: Tensor) -> Tensor:
    """Weigh samples so that ``(weights * v).sum()`` is the integral of their broken line.

    Parameters
    ----------
    times : (..., T), strictly increasing, T >= 2

    Returns
    -------
    (..., T), in the unit of ``times``; they add up to the length of the interval

    Raises
    ------
    ValueError
        If there are fewer than two times, or they do not increase.
    """
    if times.shape[-1] < 2:
        raise ValueError(f"a trapezoid needs two times; got {times.shape[-1]}")
    gaps = times.diff(dim=-1)
    if bool((gaps <= 0).any()):
        raise ValueError(f"times must increase strictly; got a gap of {gaps.min().item():g}")
    zero = torch.zeros_like(gaps[..., :1])
    return (torch.cat([gaps, zero], dim=-1) + torch.cat([zero, gaps], dim=-1)) / 2
