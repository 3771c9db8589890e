"""Loss of a skeleton prior: evidence lower bound with smooth L1 reconstruction terms."""

from collections.abc import Mapping

import torch
from torch import Tensor

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.skeleton_prior.settings import LossWeights
from pacmo_core.skeleton_prior.start import contact_weights, squared_distances
from pacmo_core.skeleton_prior.vae import Reconstruction

# Metres: distance at which the weight of a pair of joints has fallen to 1/e.
CONTACT_DISTANCE = 0.15
# Errors below this share of the displacements count quadratically, larger ones linearly, as in E_r.
QUADRATIC_BELOW = 0.1


def loss_terms(
    reconstruction: Reconstruction,
    variation: Tensor,
    template: Tensor,
    skeleton: Skeleton,
    displacement_scale: Tensor,
) -> dict[str, Tensor]:
    """Compute all terms of the loss, unweighted.

    Parameters
    ----------
    variation, template : (B, T, 2, J, 3), metres
    skeleton : Skeleton
    displacement_scale : metres, root mean square of displacements in the training data
    """
    motions = reconstruction.motions
    error = (motions - variation) / displacement_scale
    bones = _bone_lengths(motions, skeleton) - _bone_lengths(variation, skeleton)
    first, second = reconstruction.posteriors
    return {
        "position": _smooth_l1(error),
        "kl_divergence": (first.kl_divergence() + second.kl_divergence()) / 2,
        "bone_length": _smooth_l1(bones / displacement_scale),
        **_distance_terms(motions, variation, template, displacement_scale),
        "acceleration": _smooth_l1(error[:, 2:] - 2 * error[:, 1:-1] + error[:, :-2]),
    }


def total_loss(terms: Mapping[str, Tensor], weights: LossWeights, kl_warmup: float) -> Tensor:
    """Sum the weighted terms."""
    return (
        terms["position"]
        + weights.bone_length * terms["bone_length"]
        + weights.contact_distance * terms["contact_distance"]
        + weights.joint_distance * terms["joint_distance"]
        + weights.acceleration * terms["acceleration"]
        + kl_warmup * weights.kl_divergence * terms["kl_divergence"]
    )


def _smooth_l1(error: Tensor) -> Tensor:
    return _smooth_l1_each(error).mean()


def _smooth_l1_each(error: Tensor) -> Tensor:
    zero = torch.zeros_like(error)
    return torch.nn.functional.smooth_l1_loss(error, zero, reduction="none", beta=QUADRATIC_BELOW)


def _bone_lengths(motion: Tensor, skeleton: Skeleton) -> Tensor:
    parent, child = skeleton.bones.T
    lengths: Tensor = (motion[..., child, :] - motion[..., parent, :]).norm(dim=-1)
    return lengths


def _distance_terms(
    motions: Tensor, variation: Tensor, template: Tensor, displacement_scale: Tensor
) -> dict[str, Tensor]:
    """Compute the error of inter-character distances, weighted by proximity and unweighted."""
    proximity = contact_weights(squared_distances(*template.unbind(dim=2)), CONTACT_DISTANCE)
    error = (_pair_distances(motions) - _pair_distances(variation)) / displacement_scale
    loss = _smooth_l1_each(error)
    return {
        "contact_distance": (proximity * loss).sum() / proximity.sum().clamp_min(1),
        "joint_distance": loss.mean(),
    }


def _pair_distances(motions: Tensor) -> Tensor:
    """Compute distances between the characters' joints, (B, T, J, J), metres."""
    return squared_distances(*motions.unbind(dim=2)).clamp_min(1e-6).sqrt()
