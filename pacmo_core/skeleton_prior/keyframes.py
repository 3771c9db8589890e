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


def at_every_frame(field: Tensor, n_frames: int, stride: int) -> Tensor:
    """``(B, K, J, C)`` at keyframes to ``(B, T, J, C)``, by the cubic spline through them."""
    spline = CubicSpline(keyframes(n_frames, stride), field.cpu().numpy(), axis=1)
    return torch.from_numpy(spline(np.arange(n_frames)).astype(np.float32)).to(field.device)
