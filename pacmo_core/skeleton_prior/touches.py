"""What touches in the source: how far the joints that touch have come apart, and who moves."""

from functools import cached_property

import torch
from torch import Tensor

from pacmo_core.skeleton_prior.start import squared_distances

# Metres between joints of the two people: nearer ones touch, and have full weight; the weight falls
# to zero at the second distance, so that nothing starts at once.
TOUCHING, APART = 0.1, 0.2
NEAR, FAR = 0.1, 0.4


class Touches:
    """The touches of a source.

    Parameters
    ----------
    source : (T, 2, J, 3), metres
    beyond : (L, J), 1 at a limb's end and the joints beyond it
    """

    def __init__(self, source: Tensor, beyond: Tensor) -> None:
        self.source, self.beyond = source, beyond
        distances = squared_distances(source[:, 0], source[:, 1]).sqrt()
        self.weights = _falling(distances, TOUCHING, APART)  # (T, J, J): of a and b
        self.near = _falling(distances, NEAR, FAR)

    @cached_property
    def _sums(self) -> Tensor:
        """``(T, 2, J, 1)``: weights of each joint's touches together."""
        return torch.stack([self.weights.sum(dim=2), self.weights.sum(dim=1)], dim=1)[..., None]

    @cached_property
    def of_limbs(self) -> Tensor:
        """``(T, 2, L, 1)``: the largest weight of a touch from a limb's end on."""
        return self._of_limbs(self.weights)

    @cached_property
    def near_limbs(self) -> Tensor:
        """``(T, 2, L, 1)``: 1 where a limb's end is near the partner, falling to 0."""
        return self._of_limbs(self.near)

    def _of_limbs(self, weights: Tensor) -> Tensor:
        largest = torch.stack([weights.amax(dim=2), weights.amax(dim=1)], dim=1)
        return (largest[..., None, :] * self.beyond).amax(dim=-1, keepdim=True)

    def missing(self, positions: Tensor, common: Tensor) -> Tensor:
        """Sum the changes of the offsets to the partner's joints that a joint touches.

        Parameters
        ----------
        positions : (V, T, 2, J, 3), metres
        common : (V, 1, 1, 1), by which the offsets are scaled

        Returns
        -------
        (V, T, 2, J, 3), metres, weighted
        """
        a, b = (positions - common[..., None] * self.source).unbind(dim=2)
        partners = torch.stack([self.weights @ b, self.weights.mT @ a], dim=2)
        return self._sums * torch.stack([a, b], dim=2) - partners

    def half(self, missing: Tensor) -> Tensor:
        """``(V, T, 2, L, 3)``: half of a limb's mean change, faded by its largest weight."""
        total, weight = self.beyond @ missing, self.beyond @ self._sums
        return 0.5 * self.of_limbs * total / weight.clamp_min(1e-6)


def _falling(distances: Tensor, full: float, none: float) -> Tensor:
    """Weigh distances: 1 up to the first, smoothly 0 from the second on."""
    share = ((none - distances) / (none - full)).clamp(0, 1)
    return share**2 * (3 - 2 * share)
