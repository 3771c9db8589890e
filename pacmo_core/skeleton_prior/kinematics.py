"""Forward kinematics of a skeleton, and inverse kinematics (IK) of its limbs."""

import numpy as np
import torch
from torch import Tensor, nn

from pacmo_core.data.interaction import Motion, bone_lengths
from pacmo_core.data.skeleton import Skeleton

# Joint indices of shoulder, elbow, wrist, or of hip, knee, ankle.
Limb = tuple[int, int, int]

# Metres: vectors shorter than this have no direction.
MIN_LENGTH = 1e-6
# Below this share of the upper bone, the distance of the middle joint from the line between the
# limb's ends has a bounded gradient.
STRAIGHT_LIMB_SHARE = 0.05
# Length below which the pole vector, of about unit length, is normalised with a bounded gradient;
# and below which it has no direction.
SHORT_POLE, MIN_POLE = 0.1, 1e-4


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
        path = [leaf, *skeleton.ancestors(leaf)]
        limbs = [
            (path[i + 2], path[i + 1], path[i])
            for i in range(len(path) - 2)
            if {path[i], path[i + 1], path[i + 2]} <= symmetric
        ]
        if limbs:
            result.add(max(limbs, key=lambda limb: lengths[limb[1]] + lengths[limb[2]]))
    return tuple(sorted(result))


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


def perpendicular_part(vectors: Tensor, axis: Tensor) -> Tensor:
    """Reject vectors ``(..., 3)`` from unit vectors ``(..., 3)``: the perpendicular part."""
    return vectors - (vectors * axis).sum(dim=-1, keepdim=True) * axis


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


class KinematicOutput(nn.Module):
    """Output layer with exact bone lengths: forward kinematics with IK of the limbs.

    Output zero is the scaled posture: every bone has the direction that it has in the template, and
    the root its place. The decoder's output means, per joint: at the root and at the limbs' ends a
    displacement from the scaled posture, in metres; at other joints a change of the unit vector of
    the bone into the joint, or of the pole vector of a limb's middle joint, before normalisation.
    The limbs reach their ends by inverse kinematics, so that feet stay when the trunk moves.
    """

    parents: Tensor
    ancestor_matrix: Tensor
    limbs: Tensor

    def __init__(self, skeleton: Skeleton, limbs: tuple[Limb, ...]) -> None:
        super().__init__()
        self.root = skeleton.root
        # Of the root it is the root itself.
        parents = [i if p < 0 else p for i, p in enumerate(skeleton.parents)]
        self.register_buffer("parents", torch.tensor(parents), persistent=False)
        self.register_buffer("ancestor_matrix", ancestor_matrix(skeleton), persistent=False)
        index = torch.tensor(limbs, dtype=torch.int64).reshape(-1, 3)
        self.register_buffer("limbs", index, persistent=False)

    def forward(self, output: Tensor, template: Tensor, scales: Tensor) -> Tensor:
        """Compute joint positions, (B, T, J, 3) metres.

        Parameters
        ----------
        output : (B, T, J, 3), of the decoder
        template : (B, T, J, 3), metres
        scales : (B, J), of the bone into each joint
        """
        bones = self.bone_vectors(template) * scales[:, None, :, None]
        root = template[:, :, self.root]
        posture = self._joint_positions(bones, root)
        lengths = bones.norm(dim=-1, keepdim=True)
        directions = nn.functional.normalize(bones / lengths.clamp_min(MIN_LENGTH) + output, dim=-1)
        root = root + output[:, :, self.root]
        bones = self._solve_limbs(directions * lengths, root, posture, output)
        return self._joint_positions(bones, root)

    def scaled_posture(self, template: Tensor, scales: Tensor) -> Tensor:
        """Scale the bones and keep their directions, (B, T, J, 3) metres."""
        bones = self.bone_vectors(template) * scales[:, None, :, None]
        return self._joint_positions(bones, template[:, :, self.root])

    def bone_vectors(self, motion: Tensor) -> Tensor:
        """Compute the vectors ``(..., J, 3)`` from each joint's parent; zero at the root."""
        return motion - motion[..., self.parents, :]

    def _solve_limbs(self, bones: Tensor, root: Tensor, posture: Tensor, output: Tensor) -> Tensor:
        """Replace the limbs' bone vectors, of (B, T, J, 3), by the IK solution."""
        if not len(self.limbs):
            return bones
        starts, middles, ends = self.limbs.T
        positions = self._joint_positions(bones, root)
        offset = (posture + output)[:, :, ends] - positions[:, :, starts]
        pole = posture[:, :, middles] - (posture[:, :, starts] + posture[:, :, ends]) / 2
        pole = nn.functional.normalize(pole, dim=-1) + output[:, :, middles]
        upper, lower = bones[:, :, middles].norm(dim=-1), bones[:, :, ends].norm(dim=-1)
        first, second = two_bone_ik(offset, upper, lower, pole)
        return bones.index_copy(2, middles, first).index_copy(2, ends, second)

    def _joint_positions(self, bones: Tensor, root: Tensor) -> Tensor:
        """Apply forward kinematics to bone vectors (B, T, J, 3) and root positions (B, T, 3)."""
        at_root = torch.zeros_like(self.ancestor_matrix[0])
        at_root[self.root] = 1
        vectors = bones + at_root[:, None] * (root[:, :, None] - bones)
        return multiply_joints(self.ancestor_matrix, vectors)


def multiply_joints(matrix: Tensor, x: Tensor) -> Tensor:
    """Compute ``M X`` over the joints, of (J, J) and (..., J, C) with few channels.

    One product for all frames: one product per frame takes six times as long with few channels.
    """
    return (x.mT.contiguous() @ matrix.T).mT
