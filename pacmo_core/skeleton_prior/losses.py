"""What all models descend, ours and the baselines alike."""

from collections.abc import Mapping

import torch
from torch import Tensor

from pacmo_core.skeleton_prior.kinematics import CONTACT_DISTANCE
from pacmo_core.skeleton_prior.settings import LossWeights
from pacmo_core.skeleton_prior.vae import Reconstruction


def loss_terms(
    answer: Reconstruction, varied: Tensor, template: Tensor, parents: Tensor, unit: Tensor
) -> dict[str, Tensor]:
    """Take every term.

    Parameters
    ----------
    varied, template : (B, T, 2, J, 3), metres
    parents : (J,)
    unit : metres, the size of changes in the data
    """
    error = (answer.motions - varied) / unit
    bones = _bone_lengths(answer.motions, parents) - _bone_lengths(varied, parents)
    return {
        "places": _smooth_l1(error),
        "divergence": (answer.codes[0].divergence() + answer.codes[1].divergence()) / 2,
        "bones": _smooth_l1(bones / unit),
        **_distance_terms(answer.motions, varied, template, unit),
        "acceleration": _smooth_l1(error[:, 2:] - 2 * error[:, 1:-1] + error[:, :-2]),
    }


def total_loss(found: Mapping[str, Tensor], weights: LossWeights, warm: float) -> Tensor:
    """Add up.

    Parameters
    ----------
    warm : 0 to 1, the share of the divergence's weight that is in force
    """
    return (
        found["places"]
        + weights.bones * found["bones"]
        + weights.pairs * found["pairs"]
        + weights.distances * found["distances"]
        + weights.acceleration * found["acceleration"]
        + warm * weights.divergence * found["divergence"]
    )


def _smooth_l1(error: Tensor) -> Tensor:
    loss: Tensor = torch.nn.functional.smooth_l1_loss(error, torch.zeros_like(error))
    return loss


def _bone_lengths(motion: Tensor, parents: Tensor) -> Tensor:
    # The root of zero has no slope.
    return ((motion - motion[..., parents, :]).square().sum(dim=-1) + 1e-12).sqrt()


def _distance_terms(
    motions: Tensor, varied: Tensor, template: Tensor, unit: Tensor
) -> dict[str, Tensor]:
    """Take the error of distances, once weighed by how near the template has the two joints."""
    near = torch.exp(-((_pair_distances(template) / CONTACT_DISTANCE) ** 2))
    error = (_pair_distances(motions) - _pair_distances(varied)) / unit
    loss = torch.nn.functional.smooth_l1_loss(error, torch.zeros_like(error), reduction="none")
    return {
        "pairs": (near * loss).sum() / near.sum().clamp_min(1),
        "distances": loss.mean(),
    }


def _pair_distances(motions: Tensor) -> Tensor:
    """``(B, T, 2, J, 3)`` to ``(B, T, J, J)``, metres."""
    a, b = motions.unbind(dim=2)
    squares = a.square().sum(-1)[..., :, None] + b.square().sum(-1)[..., None, :]
    return (squares - 2 * a @ b.transpose(-1, -2)).clamp_min(1e-6).sqrt()
