"""Penalties on motions, and the refusal of losses that are no numbers."""

from collections.abc import Mapping

import torch
from torch import Tensor

from pacmo_core.skeleton import Skeleton


class Symmetry:
    """The soft constraint that mirror bones be of one length (PaCMO, 4.2).

    Parameters
    ----------
    skeleton : Skeleton
    """

    def __init__(self, skeleton: Skeleton) -> None:
        mirrored = torch.from_numpy(skeleton.bones[skeleton.mirrored_bones])  # (S, 2, 2)
        self.parents, self.children = mirrored.long().unbind(-1)

    def __call__(self, motion: Tensor, weights: Tensor) -> Tensor:
        """Integrate ``sum (left - right)^2`` over time, mean over the batch, metres squared.

        Parameters
        ----------
        motion : (B, T, 3 J), metres
        weights : (T,), of the quadrature
        """
        joints = motion.view(*motion.shape[:2], -1, 3)
        bones = joints[:, :, self.children] - joints[:, :, self.parents]  # (B, T, S, 2, 3)
        # The root of zero has no slope; a bone of no length is a nanometre long here.
        lengths = (bones.square().sum(dim=-1) + 1e-18).sqrt()
        asymmetry = (lengths[..., 0] - lengths[..., 1]).square().sum(dim=-1)
        integral: Tensor = asymmetry @ weights
        return integral.mean()


def finite(terms: Mapping[str, Tensor], where: str) -> dict[str, float]:
    """Read the terms of a loss as numbers.

    Raises
    ------
    FloatingPointError
        If one is not finite; the message names it.
    """
    values = {name: float(term.detach()) for name, term in terms.items()}
    broken = [name for name, term in terms.items() if not bool(torch.isfinite(term).all())]
    if broken:
        raise FloatingPointError(f"{where}: {', '.join(broken)} not finite; terms {values}")
    return values
