"""Forward kinematics of a skeleton, inverse kinematics (IK) of its limbs, and decoder outputs.

A decoder's output (B, T, J, 3) becomes joint positions in one of two ways: ``DisplacementOutput``
adds it to the template, as in the paper; ``KinematicOutput`` rotates bones of given lengths by
forward kinematics and bends arms and legs by two-bone inverse kinematics.

``mesh_residual_features`` and ``mesh_root_shift`` are what the InteractionMesh energy demands of
one character when the other one changes, to first order: inputs of a network, not a solution.
"""

import numpy as np
import torch
from torch import Tensor, nn

from pacmo_core.data.interaction import Motion, bone_lengths
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.skeleton_prior.autograd_functions import multiply_joints

# Joint indices of shoulder, elbow, wrist, or of hip, knee, ankle.
Limb = tuple[int, int, int]

# Metres: vectors shorter than this have no direction.
MIN_LENGTH = 1e-6
# Metres: height of a limb's end at which its stance weight has fallen to 1/e.
STANCE_HEIGHT = 0.2
# Below this share of the upper bone, the distance of the middle joint from the line between the
# limb's ends has a bounded gradient.
STRAIGHT_LIMB_SHARE = 0.05
# Length below which the pole vector, of about unit length, is normalised with a bounded gradient;
# and below which it has no direction.
SHORT_POLE, MIN_POLE = 0.1, 1e-4
# Cost of moving a limb's middle joint, relative to that of not following the partner.
MIDDLE_JOINT_COST = 0.1
# Share of the change of limb lengths that moves the trunk or the limb's end; bending the limb
# absorbs the rest.
ANGLE_SHARE = 0.3
# Metres: added to distances, so that the weights of touching joints stay finite.
DISTANCE_SOFTENING = 0.01
# Metres: distance at which the contact weight has fallen to 1/e, as in the InteractionMesh solver.
CONTACT_DISTANCE = 0.15


def find_limbs(skeleton: Skeleton, motion: Motion) -> tuple[Limb, ...]:
    """Find the arms and legs of a skeleton, independent of joint names.

    On each path from a leaf to the root these are the two successive bones between left-right
    symmetric joints whose total length is largest.

    Parameters
    ----------
    motion : (T, J, 3) float32, metres
    """
    symmetric = {joint for pair in skeleton.left_right for joint in pair}
    lengths = np.zeros(len(skeleton.joints))
    lengths[skeleton.bones[:, 1]] = bone_lengths(motion, skeleton).mean(axis=0)
    result: set[Limb] = set()
    for leaf in set(range(len(skeleton.joints))) - set(skeleton.parents):
        path = _path_to_root(skeleton, leaf)
        limbs = [
            (path[i + 2], path[i + 1], path[i])
            for i in range(len(path) - 2)
            if {path[i], path[i + 1], path[i + 2]} <= symmetric
        ]
        if limbs:
            result.add(max(limbs, key=lambda limb: lengths[limb[1]] + lengths[limb[2]]))
    return tuple(sorted(result))


def _path_to_root(skeleton: Skeleton, leaf: int) -> list[int]:
    path = [leaf]
    while skeleton.parents[path[-1]] >= 0:
        path.append(skeleton.parents[path[-1]])
    return path


def ancestor_matrix(skeleton: Skeleton) -> Tensor:
    """Build ``(J, J)`` float32: row j is 1 at joint j and at its ancestors, the root included.

    Forward kinematics is one product with this matrix, of the root's position and all other
    joints' bone vectors.
    """
    matrix = np.zeros((len(skeleton.joints),) * 2)
    for joint in skeleton.order:
        parent = skeleton.parents[joint]
        if parent >= 0:
            matrix[joint] = matrix[parent]
        matrix[joint, joint] = 1
    return torch.tensor(matrix, dtype=torch.float32)


def parent_indices(skeleton: Skeleton) -> Tensor:
    """List each joint's parent, ``(J,)`` int64; the root is its own parent."""
    return torch.tensor([i if p < 0 else p for i, p in enumerate(skeleton.parents)])


def shift_to_reach(start: Tensor, end: Tensor, lengths: Tensor) -> Tensor:
    """Compute the shift (..., 3), metres, that brings limbs in stance within reach of their ends.

    Parameters
    ----------
    start, end : (..., L, 3), metres: first joint of each limb, and target of its last joint
    lengths : (..., L), metres: of the stretched limbs
    """
    offset = end - start
    distance = offset.norm(dim=-1, keepdim=True).clamp_min(MIN_LENGTH)
    missing = (distance - lengths[..., None]).clamp_min(0)
    return stance_weighted_mean(missing * offset / distance, end)


def stance_weighted_mean(shifts: Tensor, ends: Tensor) -> Tensor:
    """Average limbs ``(..., L, 3)`` by stance weight: ``(..., 3)``; zero without stance."""
    weights = stance_weight(ends)
    mean: Tensor = (weights * shifts).sum(dim=-2) / weights.sum(dim=-2).clamp_min(1)
    return mean


def stance_weight(ends: Tensor) -> Tensor:
    """Weigh limb ends ``(..., L, 3)`` by height: ``(..., L, 1)``, 1 on the ground, 0 far above."""
    return torch.exp(-((ends[..., 1:2].clamp_min(0) / STANCE_HEIGHT) ** 2))


def limb_resistance(
    start: Tensor, middle: Tensor, end: Tensor, *, shift: Tensor
) -> tuple[Tensor, Tensor]:
    """Compute the resistance of a limb with a fixed end against a shift of its start.

    A limb of two equal bones whose ends are a distance L apart and whose middle joint is at a
    distance h from the line between them: when the ends close by d, that distance becomes
    sqrt(h^2 + d (L / 2 - d / 4)). The change per metre of d is large for a nearly stretched limb
    and small for a bent one. A limb extends no further than straight.

    Parameters
    ----------
    start, middle, end : (..., 3), metres
    shift : (..., 3), metres: intended shift of the start

    Returns
    -------
    axis : (..., 3), unit vector from start to end
    resistance : (..., 1), from 0 to 1: share of the shift along the axis that is suppressed
    """
    offset = end - start
    length = offset.norm(dim=-1, keepdim=True).clamp_min(MIN_LENGTH)
    axis = offset / length
    height = perpendicular_part(middle - start, axis).norm(dim=-1, keepdim=True)
    straight = (length**2 + 4 * height**2).sqrt()
    closing = (shift * axis).sum(dim=-1, keepdim=True).clamp_max(length).maximum(length - straight)
    slope = length / 2 - closing / 4
    new_height = (height**2 + closing * slope).clamp_min(0).sqrt()
    cost = MIDDLE_JOINT_COST * (slope / (height + new_height).clamp_min(MIN_LENGTH)) ** 2
    return axis, cost / (1 + cost)


def parallel_part(vectors: Tensor, axis: Tensor) -> Tensor:
    """Project vectors ``(..., 3)`` onto unit vectors ``(..., 3)``."""
    return (vectors * axis).sum(dim=-1, keepdim=True) * axis


def perpendicular_part(vectors: Tensor, axis: Tensor) -> Tensor:
    """Reject vectors ``(..., 3)`` from unit vectors ``(..., 3)``: the perpendicular part."""
    return vectors - parallel_part(vectors, axis)


def two_bone_ik(
    offset: Tensor, upper: Tensor, lower: Tensor, pole: Tensor
) -> tuple[Tensor, Tensor]:
    """Solve two-bone inverse kinematics by the law of cosines.

    A target out of reach is approached as far as the bones allow.

    Parameters
    ----------
    offset : (..., 3), metres: from the limb's start to the target of its end
    upper, lower : (...), metres: lengths of the bones
    pole : (..., 3): direction in which the middle joint points, of any length; without a direction
        the limb bends in an arbitrary one

    Returns
    -------
    two (..., 3), metres: vectors of the upper and the lower bone
    """
    # Downwards if the offset is zero: the bones need some direction.
    down = torch.tensor([0.0, -MIN_LENGTH, 0.0], dtype=offset.dtype, device=offset.device)
    offset = offset + down
    distance = offset.norm(dim=-1).clamp(min=(upper - lower).abs() + MIN_LENGTH, max=upper + lower)
    axis = torch.nn.functional.normalize(offset, dim=-1)
    bend = _normalise_with_bounded_slope(_pole_direction(pole, axis))
    # Law of cosines: the middle joint's coordinates along the axis and along the bend direction.
    along = (upper**2 - lower**2 + distance**2) / (2 * distance)
    height = _sqrt_with_bounded_slope(upper**2 - along**2, (STRAIGHT_LIMB_SHARE * upper) ** 2)
    first = _with_length(along[..., None] * axis + height[..., None] * bend, upper)
    return first, _with_length(distance[..., None] * axis - first, lower)


def _pole_direction(pole: Tensor, axis: Tensor) -> Tensor:
    """Take the pole's part perpendicular to the axis; without one, any perpendicular vector."""
    least = torch.nn.functional.one_hot(axis.abs().argmin(dim=-1), 3).to(axis)
    perpendicular = perpendicular_part(pole, axis)
    defined = perpendicular.norm(dim=-1, keepdim=True) > MIN_POLE
    return torch.where(defined, perpendicular, perpendicular_part(least, axis))


def _sqrt_with_bounded_slope(square: Tensor, threshold: Tensor) -> Tensor:
    """Take the root; its slope is zero below ``threshold``, where it would tend to infinity."""
    bounded = square.clamp_min(0).maximum(threshold).sqrt()
    return bounded + (square.clamp_min(0).sqrt() - bounded).detach()


def _normalise_with_bounded_slope(vectors: Tensor) -> Tensor:
    """Normalise; short vectors, whose direction varies fast, get the slope of longer ones."""
    length = vectors.norm(dim=-1, keepdim=True)
    bounded = vectors / length.clamp_min(SHORT_POLE).detach()
    unit = vectors / length.clamp_min(MIN_LENGTH)
    return torch.where(length > SHORT_POLE, unit, bounded + (unit - bounded).detach())


def _with_length(vectors: Tensor, lengths: Tensor) -> Tensor:
    return torch.nn.functional.normalize(vectors, dim=-1) * lengths[..., None]


class DisplacementOutput(nn.Module):
    """Output layer of the paper: joint displacements from the template."""

    def forward(self, output: Tensor, template: Tensor, scales: Tensor) -> Tensor:
        """Compute joint positions, (B, T, J, 3) metres, of displacements (B, T, J, 3)."""
        del scales
        return template + output


class KinematicOutput(nn.Module):
    """Output layer with exact bone lengths: forward kinematics with IK of the limbs.

    The decoder's output means, per joint: at the root and at the limbs' ends a displacement from
    the initial estimate, in metres; at other joints a change of the unit vector of the bone into
    the joint, or of the pole vector of a limb's middle joint, before normalisation. The limbs then
    reach their ends by inverse kinematics, so feet in stance stay in place when the trunk moves.
    The initial estimate (output zero) has the trunk, hands and feet where the template has them, as
    far as the limbs reach.

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
        # The trunk: all joints that are not descendants of a limb's upper bone.
        in_limb = self.ancestor_matrix[:, index[:, 1]].sum(dim=1) > 0
        self.register_buffer("trunk", torch.nonzero(~in_limb)[:, 0], persistent=False)

    def forward(self, output: Tensor, template: Tensor, scales: Tensor) -> Tensor:
        """Compute joint positions, (B, T, J, 3) metres.

        Parameters
        ----------
        output : (B, T, J, 3), of the decoder
        template : (B, T, J, 3), metres
        scales : (B, J), of the bone into each joint
        """
        bones = self.bone_vectors(template) * scales[:, None, :, None]
        shift = self._estimate_root_shift(bones, template)
        root = template[:, :, self.root] + shift + output[:, :, self.root]
        lengths = bones.norm(dim=-1, keepdim=True)
        directions = bones / lengths.clamp_min(MIN_LENGTH) + output
        bones = nn.functional.normalize(directions, dim=-1) * lengths
        return self._joint_positions(self._solve_limbs(bones, root, output, template), root)

    def ik_retarget(self, template: Tensor, scales: Tensor) -> Tensor:
        """Retarget by IK alone (output zero), (B, T, J, 3) metres; the template at scale 1."""
        return self.forward(torch.zeros_like(template), template, scales)

    def initial_output(self, shift: Tensor, template: Tensor, scales: Tensor) -> Tensor:
        """Compute the output that a network adds to: the character follows its partner as a whole.

        The trunk follows the partner's shift, except for the part that legs in stance resist, and
        part of the shift with which these would keep their angles: the larger, the straighter they
        are; and no further from the ground than they reach. A limb's end without stance follows
        its own limb and the partner by half each, and the change of the limb's length in part.

        Parameters
        ----------
        shift : (B, T, 3), metres: that the partner's change demands, ``mesh_root_shift``
        template : (B, T, J, 3), metres
        scales : (B, J)

        Returns
        -------
        (B, T, J, 3)
        """
        starts, middles, ends = self.limbs.T
        template_bones = self.bone_vectors(template)
        bones = template_bones * scales[:, None, :, None]
        root = template[:, :, self.root] + self._estimate_root_shift(bones, template)
        raised = (self._joint_positions(bones, root) - template)[:, :, starts]
        growth = (bones - template_bones)[:, :, middles] + (bones - template_bones)[:, :, ends]
        rigid_shift = raised + growth  # of the limb's end, were the limb to keep its angles
        limbs = (template[:, :, joints] for joints in (starts, middles, ends))
        axis, resistance = limb_resistance(*limbs, shift=shift[:, :, None] + rigid_shift)
        share = ANGLE_SHARE + (1 - ANGLE_SHARE) * resistance
        resisted = parallel_part(share * rigid_shift + resistance * shift[:, :, None], axis)
        trunk_shift = shift - stance_weighted_mean(resisted, template[:, :, ends])
        hips = self._joint_positions(bones, root + trunk_shift)[:, :, starts]
        within_reach = shift_to_reach(hips, template[:, :, ends], self._limb_lengths(bones))
        output = torch.zeros_like(template)
        output[:, :, self.root] = trunk_shift + within_reach
        followed = (self.forward(output, template, scales) - template)[:, :, starts]
        free = 1 - stance_weight(template[:, :, ends])
        end_shift = (shift[:, :, None] + followed) / 2 + ANGLE_SHARE * growth
        output[:, :, ends] = free * end_shift
        return output

    def bone_vectors(self, motion: Tensor) -> Tensor:
        """Compute the vectors ``(..., J, 3)`` from each joint's parent; zero at the root."""
        return motion - motion[..., self.parents, :]

    def _estimate_root_shift(self, bones: Tensor, template: Tensor) -> Tensor:
        """Compute the root shift (B, T, 3), metres: trunk in place and legs within reach."""
        if not len(self.limbs):
            return torch.zeros_like(template[:, :, 0])
        starts, _, ends = self.limbs.T
        positions = self._joint_positions(bones, template[:, :, self.root])
        trunk_shift = (template - positions)[:, :, self.trunk].mean(dim=2)
        start = (positions + trunk_shift[:, :, None])[:, :, starts]
        return trunk_shift + shift_to_reach(start, template[:, :, ends], self._limb_lengths(bones))

    def _solve_limbs(self, bones: Tensor, root: Tensor, output: Tensor, template: Tensor) -> Tensor:
        """Replace the limbs' bone vectors, of (B, T, J, 3), by the IK solution."""
        if not len(self.limbs):
            return bones
        starts, middles, ends = self.limbs.T
        positions = self._joint_positions(bones, root)
        offset = (template + output)[:, :, ends] - positions[:, :, starts]
        pole = template[:, :, middles] - (template[:, :, starts] + template[:, :, ends]) / 2
        pole = nn.functional.normalize(pole, dim=-1) + output[:, :, middles]
        upper, lower = bones[:, :, middles].norm(dim=-1), bones[:, :, ends].norm(dim=-1)
        first, second = two_bone_ik(offset, upper, lower, pole)
        return bones.index_copy(2, middles, first).index_copy(2, ends, second)

    def _limb_lengths(self, bones: Tensor) -> Tensor:
        _, middles, ends = self.limbs.T
        lengths: Tensor = bones[:, :, middles].norm(dim=-1) + bones[:, :, ends].norm(dim=-1)
        return lengths

    def _joint_positions(self, bones: Tensor, root: Tensor) -> Tensor:
        """Apply forward kinematics to bone vectors (B, T, J, 3) and root positions (B, T, 3)."""
        at_root = torch.zeros_like(self.ancestor_matrix[0])
        at_root[self.root] = 1
        vectors = bones + at_root[:, None] * (root[:, :, None] - bones)
        return multiply_joints(self.ancestor_matrix, vectors)


def mesh_residual_features(
    character: Tensor, partner: Tensor, character_change: Tensor, partner_change: Tensor
) -> Tensor:
    """Compute the residuals of the interaction mesh between the characters, per joint.

    The mesh connects each joint with all joints of the partner (Ho et al. 2010; supplement,
    section 1), with weights inverse to the distance, or with contact weights. Both residuals are
    zero where a joint's position relative to its weighted neighbours is that of the template.

    Parameters
    ----------
    character, partner : (B, T, J, 3), metres, template positions
    character_change, partner_change : (B, T, J, 3), metres, displacements from the template

    Returns
    -------
    (B, T, J, 10): residual by inverse distance 3, residual by contact 3, sum of contact weights 1,
    vector to the weighted mean of the partner's joints 3
    """
    distances = _distances(character, partner)
    weights = _mesh_weights(distances)
    contact = torch.exp(-((distances / CONTACT_DISTANCE) ** 2))
    contact_sum = contact.sum(dim=-1, keepdim=True)
    means = weights @ torch.cat([partner_change, partner], dim=-1)
    residual = means[..., :3] - character_change
    contact_residual = contact @ partner_change - contact_sum * character_change
    return torch.cat([residual, contact_residual, contact_sum, means[..., 3:] - character], dim=-1)


def mesh_root_shift(character: Tensor, partner: Tensor, partner_change: Tensor) -> Tensor:
    """Compute the translation of a character that brings the mesh's mean residual to zero.

    Parameters
    ----------
    character, partner : (B, T, J, 3), metres, template positions
    partner_change : (B, T, J, 3), metres, displacements from the template

    Returns
    -------
    (B, T, 3), metres
    """
    return (_mesh_weights(_distances(character, partner)) @ partner_change).mean(dim=2)


def _distances(character: Tensor, partner: Tensor) -> Tensor:
    return torch.cdist(character, partner, compute_mode="use_mm_for_euclid_dist")


def _mesh_weights(distances: Tensor) -> Tensor:
    weights = 1 / (distances + DISTANCE_SOFTENING)
    return weights / weights.sum(dim=-1, keepdim=True)
