"""Arms and legs: the first guess at a pose on another body, hands and feet where they were.

Retargeting by hand does the same: two bones reach for a place by the law of cosines.
"""

import numpy as np
import torch
from torch import Tensor

from pacmo_core.data.interaction import Motion, bone_lengths
from pacmo_core.data.skeleton import Skeleton

Limb = tuple[int, int, int]

# Metres: height at which an end of a limb no longer counts as standing.
STANDING = 0.2
# Share of its upper bone by which a limb's middle must stand aside for its bend to have a slope.
STRAIGHT = 0.05
# Likewise of the way to the side, whose unit is about 1; and below which that says nothing.
SHORT, SIDELESS = 0.1, 1e-4
# What it costs to move the middle of a limb, of what it costs to leave a body where it was.
RESISTANCE = 0.1
# Metres: shorter ways have no direction.
LEAST = 1e-6


def find_limbs(skeleton: Skeleton, motion: Motion) -> tuple[Limb, ...]:
    """Find shoulder, elbow, wrist and hip, knee, ankle, whatever their names.

    On each way from a leaf to the root, the two successive bones of mirror joints that are longest
    together.

    Parameters
    ----------
    motion : (T, J, 3) float32, metres
    """
    mirrored = {joint for pair in skeleton.left_right for joint in pair}
    lengths = np.zeros(len(skeleton.joints))
    lengths[skeleton.bones[:, 1]] = bone_lengths(motion, skeleton).mean(axis=0)
    found: set[Limb] = set()
    for leaf in set(range(len(skeleton.joints))) - set(skeleton.parents):
        chain = _chain(skeleton, leaf)
        limbs = [
            (chain[i + 2], chain[i + 1], chain[i])
            for i in range(len(chain) - 2)
            if {chain[i], chain[i + 1], chain[i + 2]} <= mirrored
        ]
        if limbs:
            found.add(max(limbs, key=lambda limb: lengths[limb[1]] + lengths[limb[2]]))
    return tuple(sorted(found))


def _chain(skeleton: Skeleton, leaf: int) -> list[int]:
    chain = [leaf]
    while skeleton.parents[chain[-1]] >= 0:
        chain.append(skeleton.parents[chain[-1]])
    return chain


def settling(start: Tensor, end: Tensor, reach: Tensor) -> Tensor:
    """Move a body to where its standing limbs reach the ground on average: ``(..., 3)`` metres.

    Parameters
    ----------
    start, end : (..., L, 3), metres: where limbs start by now and where they should end
    reach : (..., L), metres: how long they are
    """
    way = end - start
    distance = way.norm(dim=-1, keepdim=True).clamp_min(LEAST)
    short = (distance - reach[..., None]).clamp_min(0)
    return mean_of_standing(short * way / distance, end)


def mean_of_standing(moves: Tensor, ends: Tensor) -> Tensor:
    """``(..., L, 3)`` of limbs to ``(..., 3)``, of those whose ends stand; zero where none does."""
    stands = standing(ends)
    mean: Tensor = (stands * moves).sum(dim=-2) / stands.sum(dim=-2).clamp_min(1)
    return mean


def stiffness(
    start: Tensor, middle: Tensor, end: Tensor, *, asked: Tensor
) -> tuple[Tensor, Tensor]:
    """Say which way a limb resists, ``(..., 3)`` unit length, and how much, ``(..., 1)`` 0 to 1.

    To end nearer to where it starts, a limb must bend: of two bones alike, whose ends are L apart
    and whose middle stands aside by a, the middle comes to stand aside by the root of
    a^2 + d (L / 2 - d / 4) where the ends close by d. For each metre of d that is much where the
    limb is straight and d small, and the less the further it bends. A limb opens no further than
    straight.

    Parameters
    ----------
    start, middle, end : (..., 3), metres
    asked : (..., 3), metres: how far the start is asked to go, the end in its place
    """
    way = end - start
    length = way.norm(dim=-1, keepdim=True).clamp_min(LEAST)
    axis = way / length
    aside = across(middle - start, axis).norm(dim=-1, keepdim=True)
    straight = (length**2 + 4 * aside**2).sqrt()
    closed = (asked * axis).sum(dim=-1, keepdim=True).clamp_max(length).maximum(length - straight)
    further = length / 2 - closed / 4
    then = (aside**2 + closed * further).clamp_min(0).sqrt()
    resists = RESISTANCE * (further / (aside + then).clamp_min(LEAST)) ** 2
    return axis, resists / (1 + resists)


def along(way: Tensor, axis: Tensor) -> Tensor:
    """``(..., 3)``, and unit vectors: the part of a way along these."""
    return (way * axis).sum(dim=-1, keepdim=True) * axis


def across(way: Tensor, axis: Tensor) -> Tensor:
    """``(..., 3)``, and unit vectors: the part of a way aside of these."""
    return way - along(way, axis)


def standing(ends: Tensor) -> Tensor:
    """``(..., L, 3)`` metres to ``(..., L, 1)``: how much ends of limbs stand, 1 on the ground."""
    return torch.exp(-((ends[..., 1:2].clamp_min(0) / STANDING) ** 2))


def bend(way: Tensor, upper: Tensor, lower: Tensor, side: Tensor) -> tuple[Tensor, Tensor]:
    """Bend two bones so that they end where they should, or as near as they come.

    Parameters
    ----------
    way : (..., 3), metres: from where the limb starts to where it should end
    upper, lower : (...), metres: lengths of the bones
    side : (..., 3): towards where the middle joint points, of any length; where it says nothing,
        the limb bends to any side

    Returns
    -------
    two (..., 3), metres: the bones
    """
    # Down, if there is no way at all: somewhere bones must point.
    way = way + torch.tensor([0.0, -LEAST, 0.0], dtype=way.dtype, device=way.device)
    reached = way.norm(dim=-1).clamp(min=(upper - lower).abs() + LEAST, max=upper + lower)
    ahead = torch.nn.functional.normalize(way, dim=-1)
    beside = _pointing(_aside(side, ahead))
    forth = (upper**2 - lower**2 + reached**2) / (2 * reached)
    aside = _root(upper**2 - forth**2, (STRAIGHT * upper) ** 2)
    first = _as_long(forth[..., None] * ahead + aside[..., None] * beside, upper)
    return first, _as_long(reached[..., None] * ahead - first, lower)


def _aside(side: Tensor, ahead: Tensor) -> Tensor:
    """Take the part of a side across the way; of a straight limb, which has none, any."""
    least = torch.nn.functional.one_hot(ahead.abs().argmin(dim=-1), 3).to(ahead)
    beside = across(side, ahead)
    known = beside.norm(dim=-1, keepdim=True) > SIDELESS
    return torch.where(known, beside, across(least, ahead))


def _root(square: Tensor, steep: Tensor) -> Tensor:
    """Take the root; below ``steep``, where its slope goes to infinity, without a slope."""
    gentle = square.clamp_min(0).maximum(steep).sqrt()
    return gentle + (square.clamp_min(0).sqrt() - gentle).detach()


def _pointing(way: Tensor) -> Tensor:
    """Set to unit length; what is short, whose direction turns fast, has the slope of a longer."""
    length = way.norm(dim=-1, keepdim=True)
    gentle = way / length.clamp_min(SHORT).detach()
    steep = way / length.clamp_min(LEAST)
    return torch.where(length > SHORT, steep, gentle + (steep - gentle).detach())


def _as_long(bones: Tensor, lengths: Tensor) -> Tensor:
    return torch.nn.functional.normalize(bones, dim=-1) * lengths[..., None]
