"""Feet that stand: what supports a body in the source does not slide on another body."""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pacmo_core.data.interaction import Interaction
from pacmo_core.interaction_mesh import Scene, Support
from pacmo_core.interaction_mesh.mesh import ground_supports

# What the solver takes for support by default (``augment.solver.support``).
SUPPORT = Support(max_height=0.2, height_tolerance=0.03, max_speed=0.2, fade_time=0.25)


def find_supports(source: Interaction) -> NDArray[np.bool_]:
    """Find which joints support person a and person b in each frame, (T, 2, J)."""
    scene = Scene((source.person_a, source.person_b), (source.skeleton,) * 2, source.fps)
    return ground_supports(scene, SUPPORT).reshape(len(source.times), 2, -1)


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
