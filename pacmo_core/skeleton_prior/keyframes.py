"""The few frames that networks see, and the way back to all of them: the change is smooth."""

from functools import lru_cache

import numpy as np
import torch
from scipy.interpolate import CubicSpline
from torch import Tensor


@lru_cache(maxsize=64)
def keyframes(n_frames: int, stride: int) -> tuple[int, ...]:
    """Choose frames about ``stride`` apart, the first and the last among them."""
    n_keys = -(-(n_frames - 1) // stride) + 1
    return tuple(np.linspace(0, n_frames - 1, n_keys).round().astype(int).tolist())


@lru_cache(maxsize=64)
def between(n_frames: int, stride: int) -> Tensor:
    """``(T, K)`` float32: the cubic spline through values at keyframes, at every frame."""
    keys = keyframes(n_frames, stride)
    spline = CubicSpline(keys, np.eye(len(keys)))
    return torch.tensor(spline(np.arange(n_frames)), dtype=torch.float32)


def at_every_frame(field: Tensor, n_frames: int, stride: int) -> Tensor:
    """``(B, K, J, C)`` at keyframes to ``(B, T, J, C)``."""
    weights = between(n_frames, stride).to(field)
    flat = weights @ field.reshape(*field.shape[:2], -1)
    return flat.view(len(field), n_frames, *field.shape[2:])
