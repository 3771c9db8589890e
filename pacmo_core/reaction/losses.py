"""Penalties on motions, and the refusal of losses that are no numbers."""

import torch
from torch import Tensor

from pacmo_core.data.skeleton import Skeleton


class Symmetry:
    """The soft constraint that mirror bones be of one length (PaCMO, 4.2).

    Parameters
    ----------
    skeleton : Skeleton
    """

    def __init__(self, skeleton: Skeleton) -> None:
        self.bones = torch.from_numpy(skeleton.bones[skeleton.mirrored_bones])  # (S, 2, 2)

    def __call__(self, motion: Tensor, weights: Tensor) -> Tensor:
        """Integrate ``sum (left - right)^2`` over time, mean over the batch, metres squared.

        Parameters
        ----------
        motion : (B, T, 3 J), metres
        weights : (T,), of the quadrature
        """
        left, right = _lengths(motion, self.bones).unbind(-1)
        integral: Tensor = (left - right).square().sum(dim=-1) @ weights
        return integral.mean()


class ConstantBones:
    """The soft constraint that bones keep their lengths: joints' positions alone can stretch.

    Parameters
    ----------
    skeleton : Skeleton
    """

    def __init__(self, skeleton: Skeleton) -> None:
        self.bones = torch.from_numpy(skeleton.bones)  # (J - 1, 2)

    def __call__(self, motion: Tensor, weights: Tensor) -> Tensor:
        """Sum the bones' variances over time, mean over the batch, metres squared.

        Parameters
        ----------
        motion : (B, T, 3 J), metres
        weights : (T,), of the quadrature on [0, 1]; they sum to 1
        """
        lengths = _lengths(motion, self.bones).transpose(1, 2)  # (B, J - 1, T)
        departure = lengths - (lengths @ weights)[..., None]
        variance: Tensor = departure.square() @ weights
        return variance.sum(dim=-1).mean()


def _lengths(motion: Tensor, bones: Tensor) -> Tensor:
    """``(B, T, 3 J)`` and ``(..., 2)`` parents and children to ``(B, T, ...)`` metres."""
    joints = motion.view(*motion.shape[:2], -1, 3)
    parents, children = bones.long().unbind(-1)
    bone = joints[:, :, children] - joints[:, :, parents]
    # The root of zero has no slope; a bone of no length is a nanometre long here.
    length: Tensor = (bone.square().sum(dim=-1) + 1e-18).sqrt()
    return length
