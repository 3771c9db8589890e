"""Ends of limbs that support the body: they do not slide on another body, and the root follows."""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pacmo_core.interaction_mesh.mesh import support_steps

# Seconds without support that do not end a stance: the displacement from the source stays.
MAX_GAP = 0.2
# Metres over the source's height at which a foot may stand: the solver, too, lifts feet of smaller
# bodies by as much where hands touch.
MAX_LIFT = 0.015
# Iterations that find the root's place, and what holds the root against the limbs' 1.
ROOT_STEPS = 5
ROOT_WEIGHTS = (0.1, 3e-3, 0.1)


def hanging_path(
    frame: Tensor,
    source: Tensor,
    beyond: Tensor,
    ends: Tensor,
    supports: NDArray[np.bool_],
) -> Tensor:
    """Path of the displacement of a limb's end for which the joints that support do not slide.

    A foot of another length that rolls over its toes moves its ankle differently.

    Parameters
    ----------
    frame, source : (V, T, 2, J, 3) and (T, 2, J, 3), metres: bodies and source, at any place
    beyond : (L, J), 1 at a limb's end and the joints beyond it
    ends : (L,), joints
    supports : (T, 2, J)

    Returns
    -------
    (V, T, 2, L, 3), metres, horizontal, from any place
    """
    steps = torch.from_numpy(support_steps(supports.reshape(len(supports), -1)))
    steps = steps.reshape(-1, *supports.shape[1:]).to(frame)  # (T - 1, 2, J)
    path = torch.zeros_like(frame[..., ends, :])
    for limb, end in enumerate(ends.tolist()):
        moved = (frame - frame[..., end : end + 1, :]) - (source - source[..., end : end + 1, :])
        weights = steps * beyond[limb]
        weights = weights / weights.sum(dim=-1, keepdim=True).clamp_min(1)
        rolled = -(weights[..., None] * moved.diff(dim=1)).sum(dim=-2)
        path[:, 1:, :, limb] = rolled.cumsum(dim=1)
    return path * path.new_tensor([1.0, 0.0, 1.0])


def planted_corrections(
    displacements: Tensor, rises: Tensor, supporting: NDArray[np.bool_], fps: float
) -> Tensor:
    """Compute what makes displacements constant for a whole stance, and heights what they are.

    In a stance the horizontal displacement becomes its mean, and so does the height over the
    source's, between 0 and ``MAX_LIFT``. The correction is interpolated from
    one stance to the next, and kept before the first and after the last.

    Parameters
    ----------
    displacements : (V, T, 2, L, 3), metres, of the limbs' ends from the source
    rises : (V, T, 2, L), metres by which a limb's end would rise if it stood
    supporting : (T, 2, L)
    fps : frames per second

    Returns
    -------
    (V, T, 2, L, 3), metres, to be added
    """
    corrections = torch.zeros_like(displacements)
    for person, limb in np.ndindex(*supporting.shape[1:]):
        frames = np.flatnonzero(supporting[:, person, limb])
        if not len(frames):
            continue
        breaks = np.flatnonzero(np.diff(frames) > 1 + MAX_GAP * fps) + 1
        stances = [np.arange(s[0], s[-1] + 1) for s in np.split(frames, breaks)]
        frames = np.concatenate(stances)
        own = displacements[:, :, person, limb]
        fixed = torch.cat([own[:, s].mean(dim=1, keepdim=True) - own[:, s] for s in stances], dim=1)
        up = rises[:, :, person, limb]
        fixed[..., 1] = torch.cat(
            [up[:, s] - up[:, s].mean(dim=1, keepdim=True).clamp(-MAX_LIFT, 0) for s in stances],
            dim=1,
        )
        places = np.interp(np.arange(len(supporting)), frames, np.arange(len(frames)))
        before = np.floor(places).astype(int)
        after = np.minimum(before + 1, len(frames) - 1)
        share = torch.tensor(places - before).to(own)[:, None]
        share = share**2 * (3 - 2 * share)  # at rest at either end
        corrections[:, :, person, limb] = torch.lerp(fixed[:, before], fixed[:, after], share)
    return corrections


def reach_ends(offsets: Tensor, lengths: Tensor, weights: Tensor, moved: Tensor) -> Tensor:
    """Find the shift of the root with which limbs reach their ends at given lengths.

    Weighted least squares of the lengths, by Gauss-Newton; a limb is asked for its length only, so
    that it may turn about its end.

    Parameters
    ----------
    offsets : (V, T, 2, L, 3), metres, from each limb's start to its end
    lengths : (V, T, 2, L), metres
    weights : (T, 2, L)
    moved : (V, T, 2, 3), metres by which the root has been moved already

    Returns
    -------
    (V, T, 2, 3), metres
    """
    shift = torch.zeros_like(offsets[..., 0, :])
    held = torch.diag(offsets.new_tensor(ROOT_WEIGHTS))
    for _ in range(ROOT_STEPS):
        left = offsets - shift[..., None, :]
        distances = left.norm(dim=-1)
        directions = torch.nn.functional.normalize(left, dim=-1)
        weighted = weights[..., None] * directions
        pull = (weighted * (distances - lengths)[..., None]).sum(dim=-2)
        pull = pull - (moved + shift) @ held
        shift = shift + torch.linalg.solve(weighted.mT @ directions + held, pull)
    return shift
