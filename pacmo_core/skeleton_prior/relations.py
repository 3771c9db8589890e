"""What one body's change means to the other: the interaction mesh's pull, not solved for."""

import torch
from torch import Tensor

# Metres: added to distances so that joints that touch do not silence all others.
SOFTENING = 0.01
# Metres: at which contact has fallen to 1/e, as the solver that made the variations has it.
REACH = 0.15


def pulls(own: Tensor, partner: Tensor, own_change: Tensor, partner_change: Tensor) -> Tensor:
    """By how much a joint lags behind what the partner's change asks of it.

    The weights are those of the complete interaction mesh between the bodies (Ho et al. 2010;
    supplement, section 1): once inverse to distance, once of contact alone. Where both pulls are
    zero the relations to the partner are those of the source.

    Parameters
    ----------
    own, partner : (B, T, J, 3), metres, of the template
    own_change, partner_change : (B, T, J, 3), metres, from it

    Returns
    -------
    (B, T, J, 10): pull of all joints 3, of touching ones 3, how much is touched 1, way to the
    partner 3
    """
    distances = _distances(own, partner)
    far = _weights(distances)
    touch = torch.exp(-((distances / REACH) ** 2))
    touched = touch.sum(dim=-1, keepdim=True)
    asked = far @ torch.cat([partner_change, partner], dim=-1)
    pull = asked[..., :3] - own_change
    contact = touch @ partner_change - touched * own_change
    return torch.cat([pull, contact, touched, asked[..., 3:] - own], dim=-1)


def asked_shift(own: Tensor, partner: Tensor, partner_change: Tensor) -> Tensor:
    """By how much the partner's change asks a body as a whole to come along.

    Where a body goes so far, and changes in no other way, the mesh between the two is on average
    what it was.

    Parameters
    ----------
    own, partner : (B, T, J, 3), metres, of the template
    partner_change : (B, T, J, 3), metres, from it

    Returns
    -------
    (B, T, 3), metres
    """
    return (_weights(_distances(own, partner)) @ partner_change).mean(dim=2)


def _distances(own: Tensor, partner: Tensor) -> Tensor:
    return torch.cdist(own, partner, compute_mode="use_mm_for_euclid_dist")


def _weights(distances: Tensor) -> Tensor:
    far = 1 / (distances + SOFTENING)
    return far / far.sum(dim=-1, keepdim=True)
