"""Feet that stand: what supports a body in the source does not slide on another body."""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor


def planting_corrections(displacements: Tensor, is_support: NDArray[np.bool_]) -> Tensor:
    """Compute what makes displacements constant while a limb end supports.

    In a stretch of support the displacement becomes its mean; the correction is interpolated from
    one stretch to the next, and kept before the first and after the last.

    Parameters
    ----------
    displacements : (V, T, L, C), metres, from the source
    is_support : (T, L)

    Returns
    -------
    (V, T, L, C), metres, to be added
    """
    corrections = torch.zeros_like(displacements)
    for limb, supports in enumerate(is_support.T):
        frames = np.flatnonzero(supports)
        if not len(frames):
            continue
        stretches = np.split(frames, np.flatnonzero(np.diff(frames) > 1) + 1)
        own = displacements[:, :, limb]
        fixed = torch.cat(
            [own[:, stretch].mean(dim=1, keepdim=True) - own[:, stretch] for stretch in stretches],
            dim=1,
        )
        places = np.interp(np.arange(len(supports)), frames, np.arange(len(frames)))
        before = np.floor(places).astype(int)
        after = np.minimum(before + 1, len(frames) - 1)
        share = torch.tensor(places - before).to(own)[:, None]
        corrections[:, :, limb] = torch.lerp(fixed[:, before], fixed[:, after], share)
    return corrections
