"""What one body's change means to the other: the interaction mesh's pull, not solved for."""

import numpy as np
import torch
from torch import Tensor, nn

from pacmo_core.data.interaction import Motion, bone_lengths
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.skeleton_prior.autograd_functions import multiply_joints

# Metres: added to distances so that joints that touch do not silence all others.
DISTANCE_SOFTENING = 0.01
# Metres: at which contact has fallen to 1/e, as the solver that made the variations has it.
CONTACT_DISTANCE = 0.15


def mesh_residual_features(
    own: Tensor, partner: Tensor, own_change: Tensor, partner_change: Tensor
) -> Tensor:
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
    far = _mesh_weights(distances)
    touch = torch.exp(-((distances / CONTACT_DISTANCE) ** 2))
    touched = touch.sum(dim=-1, keepdim=True)
    asked = far @ torch.cat([partner_change, partner], dim=-1)
    pull = asked[..., :3] - own_change
    contact = touch @ partner_change - touched * own_change
    return torch.cat([pull, contact, touched, asked[..., 3:] - own], dim=-1)


def mesh_root_shift(own: Tensor, partner: Tensor, partner_change: Tensor) -> Tensor:
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
    return (_mesh_weights(_distances(own, partner)) @ partner_change).mean(dim=2)


def _distances(own: Tensor, partner: Tensor) -> Tensor:
    return torch.cdist(own, partner, compute_mode="use_mm_for_euclid_dist")


def _mesh_weights(distances: Tensor) -> Tensor:
    far = 1 / (distances + DISTANCE_SOFTENING)
    return far / far.sum(dim=-1, keepdim=True)


# FROM """Arms and legs: the first guess at a pose on another body, hands and feet where they were.
# FROM
# FROM Retargeting by hand does the same: two bones reach for a place by the law of cosines.
# FROM """
Limb = tuple[int, int, int]

# Metres: height at which an end of a limb no longer counts as standing.
STANCE_HEIGHT = 0.2
# Share of its upper bone by which a limb's middle must stand aside for its bend to have a slope.
STRAIGHT_LIMB_SHARE = 0.05
# Likewise of the way to the side, whose unit is about 1; and below which that says nothing.
SHORT_POLE, MIN_POLE = 0.1, 1e-4
# What it costs to move the middle of a limb, of what it costs to leave a body where it was.
MIDDLE_JOINT_COST = 0.1
# Metres: shorter ways have no direction.
MIN_DISTANCE = 1e-6


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
        chain = _path_to_root(skeleton, leaf)
        limbs = [
            (chain[i + 2], chain[i + 1], chain[i])
            for i in range(len(chain) - 2)
            if {chain[i], chain[i + 1], chain[i + 2]} <= mirrored
        ]
        if limbs:
            found.add(max(limbs, key=lambda limb: lengths[limb[1]] + lengths[limb[2]]))
    return tuple(sorted(found))


def _path_to_root(skeleton: Skeleton, leaf: int) -> list[int]:
    chain = [leaf]
    while skeleton.parents[chain[-1]] >= 0:
        chain.append(skeleton.parents[chain[-1]])
    return chain


def shift_to_reach(start: Tensor, end: Tensor, reach: Tensor) -> Tensor:
    """Move a body to where its standing limbs reach the ground on average: ``(..., 3)`` metres.

    Parameters
    ----------
    start, end : (..., L, 3), metres: where limbs start by now and where they should end
    reach : (..., L), metres: how long they are
    """
    way = end - start
    distance = way.norm(dim=-1, keepdim=True).clamp_min(MIN_DISTANCE)
    short = (distance - reach[..., None]).clamp_min(0)
    return stance_weighted_mean(short * way / distance, end)


def stance_weighted_mean(moves: Tensor, ends: Tensor) -> Tensor:
    """``(..., L, 3)`` of limbs to ``(..., 3)``, of those whose ends stand; zero where none does."""
    stands = stance_weight(ends)
    mean: Tensor = (stands * moves).sum(dim=-2) / stands.sum(dim=-2).clamp_min(1)
    return mean


def limb_resistance(
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
    length = way.norm(dim=-1, keepdim=True).clamp_min(MIN_DISTANCE)
    axis = way / length
    aside = perpendicular_part(middle - start, axis).norm(dim=-1, keepdim=True)
    straight = (length**2 + 4 * aside**2).sqrt()
    closed = (asked * axis).sum(dim=-1, keepdim=True).clamp_max(length).maximum(length - straight)
    further = length / 2 - closed / 4
    then = (aside**2 + closed * further).clamp_min(0).sqrt()
    resists = MIDDLE_JOINT_COST * (further / (aside + then).clamp_min(MIN_DISTANCE)) ** 2
    return axis, resists / (1 + resists)


def parallel_part(way: Tensor, axis: Tensor) -> Tensor:
    """``(..., 3)``, and unit vectors: the part of a way along these."""
    return (way * axis).sum(dim=-1, keepdim=True) * axis


def perpendicular_part(way: Tensor, axis: Tensor) -> Tensor:
    """``(..., 3)``, and unit vectors: the part of a way aside of these."""
    return way - parallel_part(way, axis)


def stance_weight(ends: Tensor) -> Tensor:
    """``(..., L, 3)`` metres to ``(..., L, 1)``: how much ends of limbs stand, 1 on the ground."""
    return torch.exp(-((ends[..., 1:2].clamp_min(0) / STANCE_HEIGHT) ** 2))


def two_bone_ik(way: Tensor, upper: Tensor, lower: Tensor, side: Tensor) -> tuple[Tensor, Tensor]:
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
    way = way + torch.tensor([0.0, -MIN_DISTANCE, 0.0], dtype=way.dtype, device=way.device)
    reached = way.norm(dim=-1).clamp(min=(upper - lower).abs() + MIN_DISTANCE, max=upper + lower)
    ahead = torch.nn.functional.normalize(way, dim=-1)
    beside = _normalise_with_bounded_slope(_pole_direction(side, ahead))
    forth = (upper**2 - lower**2 + reached**2) / (2 * reached)
    aside = _sqrt_with_bounded_slope(upper**2 - forth**2, (STRAIGHT_LIMB_SHARE * upper) ** 2)
    first = _with_length(forth[..., None] * ahead + aside[..., None] * beside, upper)
    return first, _with_length(reached[..., None] * ahead - first, lower)


def _pole_direction(side: Tensor, ahead: Tensor) -> Tensor:
    """Take the part of a side across the way; of a straight limb, which has none, any."""
    least = torch.nn.functional.one_hot(ahead.abs().argmin(dim=-1), 3).to(ahead)
    beside = perpendicular_part(side, ahead)
    known = beside.norm(dim=-1, keepdim=True) > MIN_POLE
    return torch.where(known, beside, perpendicular_part(least, ahead))


def _sqrt_with_bounded_slope(square: Tensor, steep: Tensor) -> Tensor:
    """Take the root; below ``steep``, where its slope goes to infinity, without a slope."""
    gentle = square.clamp_min(0).maximum(steep).sqrt()
    return gentle + (square.clamp_min(0).sqrt() - gentle).detach()


def _normalise_with_bounded_slope(way: Tensor) -> Tensor:
    """Set to unit length; what is short, whose direction turns fast, has the slope of a longer."""
    length = way.norm(dim=-1, keepdim=True)
    gentle = way / length.clamp_min(SHORT_POLE).detach()
    steep = way / length.clamp_min(MIN_DISTANCE)
    return torch.where(length > SHORT_POLE, steep, gentle + (steep - gentle).detach())


def _with_length(bones: Tensor, lengths: Tensor) -> Tensor:
    return torch.nn.functional.normalize(bones, dim=-1) * lengths[..., None]


# FROM """From what a network says to where joints are: plain offsets, or bones of the right length."""
# Metres: below this a bone's direction is left to the network.
MIN_BONE_LENGTH = 1e-6
# Share of what limbs of other lengths would ask for, were they to keep their angles, that they get:
# for the rest they bend.
ANGLE_SHARE = 0.3


def ancestor_matrix(skeleton: Skeleton) -> Tensor:
    """``(J, J)`` float32: 1 where the bone into a column's joint leads to a row's joint.

    The root's own column is 1 throughout: with the root's place there and bone vectors elsewhere,
    one product of matrices places all joints.
    """
    between = np.zeros((len(skeleton.joints),) * 2)
    for joint in skeleton.order:
        parent = skeleton.parents[joint]
        if parent >= 0:
            between[joint] = between[parent]
        between[joint, joint] = 1
    return torch.tensor(between, dtype=torch.float32)


def parent_indices(skeleton: Skeleton) -> Tensor:
    """``(J,)`` int64: each joint's parent, the root its own."""
    return torch.tensor([i if p < 0 else p for i, p in enumerate(skeleton.parents)])


class DisplacementOutput(nn.Module):
    """The paper's form: a joint stands where the template has it, and an offset from there."""

    def forward(self, field: Tensor, template: Tensor, scales: Tensor) -> Tensor:
        """``(B, T, J, 3)`` offsets to ``(B, T, J, 3)`` places, metres."""
        del scales
        return template + field


class KinematicOutput(nn.Module):
    """Our form: forward kinematics, so that every bone has its length exactly.

    The field says, at the root and at the ends of limbs, by how many metres to stand elsewhere than
    guessed; at other joints, what is added to the unit vector of the bone, or of the side to which
    a limb bends, before it is set to unit length again. Limbs then reach for their ends, so a body
    that moves keeps its feet where they stand. The guess is what no field gives: the template with
    the trunk about its place, hands and feet in theirs, as far as limbs reach.

    Parameters
    ----------
    skeleton : Skeleton
    limbs : its arms and legs
    """

    parents: Tensor
    ancestor_matrix: Tensor
    limbs: Tensor
    trunk: Tensor

    def __init__(self, skeleton: Skeleton, limbs: tuple[Limb, ...]) -> None:
        super().__init__()
        self.root = skeleton.root
        self.register_buffer("parents", parent_indices(skeleton), persistent=False)
        self.register_buffer("ancestor_matrix", ancestor_matrix(skeleton), persistent=False)
        index = torch.tensor(limbs, dtype=torch.int64).reshape(-1, 3)
        self.register_buffer("limbs", index, persistent=False)
        # The trunk: what no limb's two bones carry.
        carried = self.ancestor_matrix[:, index[:, 1]].sum(dim=1) > 0
        self.register_buffer("trunk", torch.nonzero(~carried)[:, 0], persistent=False)

    def forward(self, field: Tensor, template: Tensor, scales: Tensor) -> Tensor:
        """``(B, T, J, 3)`` to ``(B, T, J, 3)`` places, metres.

        Parameters
        ----------
        field, template : (B, T, J, 3)
        scales : (B, J)
        """
        bones = self.bones(template) * scales[:, None, :, None]
        root = template[:, :, self.root] + self._settled(bones, template) + field[:, :, self.root]
        lengths = bones.norm(dim=-1, keepdim=True)
        bones = (
            nn.functional.normalize(bones / lengths.clamp_min(MIN_BONE_LENGTH) + field, dim=-1)
            * lengths
        )
        return self._placed(self._reaching(bones, root, field, template), root)

    def guess(self, template: Tensor, scales: Tensor) -> Tensor:
        """Place what a zero field places, (B, T, J, 3) metres; at scale 1 that is the template."""
        return self.forward(torch.zeros_like(template), template, scales)

    def starting_field(self, shift: Tensor, template: Tensor, scales: Tensor) -> Tensor:
        """Give the field from which a network starts: what the mesh asks of a body as a whole.

        The trunk goes where the partner asks it to, but for what legs that stand resist, and some
        of the way to where these would keep their angles: the more, the straighter they are; and no
        further from the ground than they reach. An end that does not stand is tied to its own arm
        as much as to the partner, so it goes half with each, and some of the way to where its arm
        would keep its angles.

        Parameters
        ----------
        shift : (B, T, 3), metres: what the partner asks for
        template : (B, T, J, 3), metres
        scales : (B, J)

        Returns
        -------
        (B, T, J, 3)
        """
        starts, middles, ends = self.limbs.T
        before = self.bones(template)
        bones = before * scales[:, None, :, None]
        root = template[:, :, self.root] + self._settled(bones, template)
        raised = (self._placed(bones, root) - template)[:, :, starts]
        longer = (bones - before)[:, :, middles] + (bones - before)[:, :, ends]
        bent = raised + longer
        limbs = (template[:, :, joints] for joints in (starts, middles, ends))
        axis, stiff = limb_resistance(*limbs, asked=shift[:, :, None] + bent)
        resisted = parallel_part(
            (ANGLE_SHARE + (1 - ANGLE_SHARE) * stiff) * bent + stiff * shift[:, :, None], axis
        )
        gone = shift - stance_weighted_mean(resisted, template[:, :, ends])
        hips = self._placed(bones, root + gone)[:, :, starts]
        field = torch.zeros_like(template)
        field[:, :, self.root] = gone + shift_to_reach(
            hips, template[:, :, ends], self._reach(bones)
        )
        carried = (self.forward(field, template, scales) - template)[:, :, starts]
        free = 1 - stance_weight(template[:, :, ends])
        field[:, :, ends] = free * ((shift[:, :, None] + carried) / 2 + ANGLE_SHARE * longer)
        return field

    def bones(self, motion: Tensor) -> Tensor:
        """``(..., J, 3)`` vectors from each joint's parent; the root's is zero."""
        return motion - motion[..., self.parents, :]

    def _settled(self, bones: Tensor, template: Tensor) -> Tensor:
        """Guess how far the root moves, (B, T, 3) metres: the trunk about its place, legs on it."""
        if not len(self.limbs):
            return torch.zeros_like(template[:, :, 0])
        starts, _, ends = self.limbs.T
        placed = self._placed(bones, template[:, :, self.root])
        centred = (template - placed)[:, :, self.trunk].mean(dim=2)
        start = (placed + centred[:, :, None])[:, :, starts]
        return centred + shift_to_reach(start, template[:, :, ends], self._reach(bones))

    def _reaching(self, bones: Tensor, root: Tensor, field: Tensor, template: Tensor) -> Tensor:
        """Let limbs reach for their ends: bones (B, T, J, 3) to the same, of their lengths."""
        if not len(self.limbs):
            return bones
        starts, middles, ends = self.limbs.T
        placed = self._placed(bones, root)
        way = (template + field)[:, :, ends] - placed[:, :, starts]
        side = template[:, :, middles] - (template[:, :, starts] + template[:, :, ends]) / 2
        side = nn.functional.normalize(side, dim=-1) + field[:, :, middles]
        upper, lower = bones[:, :, middles].norm(dim=-1), bones[:, :, ends].norm(dim=-1)
        first, second = two_bone_ik(way, upper, lower, side)
        return bones.index_copy(2, middles, first).index_copy(2, ends, second)

    def _reach(self, bones: Tensor) -> Tensor:
        _, middles, ends = self.limbs.T
        reach: Tensor = bones[:, :, middles].norm(dim=-1) + bones[:, :, ends].norm(dim=-1)
        return reach

    def _placed(self, bones: Tensor, root: Tensor) -> Tensor:
        at_root = torch.zeros_like(self.ancestor_matrix[0])
        at_root[self.root] = 1
        return multiply_joints(
            self.ancestor_matrix, bones + at_root[:, None] * (root[:, :, None] - bones)
        )
