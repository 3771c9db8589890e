"""The finish: what a network or the start leaves of joint angles, feet and touches is set right.

A network comes near the solver's motion, and near is visible: a knee gives by some degrees, a foot
that stands glides by a centimetre, a hand stops short of the shoulder that it held. The finish
changes a pair of motions on given bodies by what the source says of them, by closed forms and few
iterations, without any weight that is learnt.

1. **Bones and angles.** Every bone takes its length. Hands and feet keep the direction that they
   have in the source, and knees and elbows their angle: the end of a limb lies on a sphere about
   its start, in the direction in which the network has it.
2. **Stances.** The end of a limb that supports the body keeps its displacement for the whole
   stance, with its lowest joint at the source's height; the root follows, held to its place, and
   hips tilt, so that legs reach at the angle of their knees (``stances``).
3. **Touches.** Joints of the two people that touch in the source keep their offset: limbs that
   support nothing move towards it from both sides (``touches``).

Everything turns with a scene that is turned about the vertical, and nothing changes where bodies
and motions are the source's.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from torch import Tensor
from torch.nn.functional import normalize

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.interaction_mesh.mesh import support_weights
from pacmo_core.skeleton_prior.kinematics import (
    Limb,
    ancestor_matrix,
    multiply_joints,
    two_bone_ik,
)
from pacmo_core.skeleton_prior.stances import hanging_path, planted_corrections, reach_ends
from pacmo_core.skeleton_prior.touches import Touches

# Times that the root follows the feet and the feet's places the root.
FOLLOWING_STEPS = 4
# Times that the filtered root is moved to where limbs reach.
REACHING_STEPS = 6
# Seconds in which what holds a limb's end that supports fades in and out.
FADE_SECONDS = 0.25
# Seconds, standard deviation of the filter on what the root is moved by.
SMOOTHING_SECONDS = 0.1
# Times that limbs take half of what touches miss.
TOUCHING_STEPS = 8
# Seconds, standard deviation of the filter on each of these steps.
TOUCHING_SMOOTHING = 0.05
# Square metres: an axis or pole whose square is less has no direction.
MIN_SQUARE = 1e-12


@dataclass(frozen=True)
class Finish:
    """The finish of motions that one source was retargeted to.

    Parameters
    ----------
    skeleton : of both people
    limbs : its arms and legs
    source : (T, 2, J, 3) float32, metres, y up
    supports : (T, 2, J), which joints support their body
    fps : frames per second
    """

    skeleton: Skeleton
    limbs: tuple[Limb, ...]
    source: Tensor
    supports: NDArray[np.bool_]
    fps: float

    def __call__(self, motions: Tensor, scales: Tensor) -> Tensor:
        """Finish motions (V, T, 2, J, 3), metres, on bodies whose bones have scales (V, 2, J)."""
        bodies = _Bodies(self, motions, scales)
        if self.limbs:
            bodies.stand()
            bodies.touch()
        return bodies.positions()

    @cached_property
    def beyond(self) -> Tensor:
        """``(L, J)`` float32: 1 at a limb's end and at the joints beyond it."""
        return self.below[:, [end for _, _, end in self.limbs]].T

    @cached_property
    def below(self) -> Tensor:
        """``(J, J)`` float32: ``ancestor_matrix``."""
        return ancestor_matrix(self.skeleton)

    @cached_property
    def parents(self) -> list[int]:
        """Parents of the joints; of the root it is the root itself."""
        return [joint if p < 0 else p for joint, p in enumerate(self.skeleton.parents)]

    @cached_property
    def touches(self) -> Touches:
        """What touches in the source."""
        return Touches(self.source, self.beyond)

    @cached_property
    def holds(self) -> Tensor:
        """``(T, 2, L, 1)``: 1 where a limb's end supports, fading to 0 before and after."""
        supporting = self.supports @ (self.beyond.numpy().T > 0)
        held = support_weights(supporting.reshape(len(supporting), -1), self.fps, FADE_SECONDS)
        return torch.tensor(held.reshape(supporting.shape), dtype=torch.float32)[..., None]


class _Bodies:
    """The bodies while they are finished: the root, the ends of limbs, the bones between others."""

    def __init__(self, finish: Finish, motions: Tensor, scales: Tensor) -> None:
        self.given, self.source, self.scales = finish, finish.source, scales
        self.starts, self.middles, self.ends = torch.tensor(finish.limbs).reshape(-1, 3).T
        source_bones = self.source - self.source[..., finish.parents, :]
        lengths = source_bones.norm(dim=-1) * scales[:, None]
        hangs = finish.beyond.sum(dim=0) > 0
        hangs[self.ends] = False
        bones = torch.where(hangs[:, None], source_bones, motions - motions[..., finish.parents, :])
        self.bones = normalize(bones, dim=-1) * lengths[..., None]
        self.root = motions[..., finish.skeleton.root, :]
        self.upper, self.lower = lengths[..., self.middles], lengths[..., self.ends]
        self.bent = bent_length(source_bones[..., self.middles, :], source_bones[..., self.ends, :],
                                self.upper, self.lower)  # fmt: skip
        self.frame = multiply_joints(finish.below, self.bones)  # from the root, limbs apart
        ends = motions[..., self.ends, :]
        self.targets = torch.lerp(
            self.on_spheres(ends), ends, finish.touches.near_limbs.expand_as(ends)
        )

    def limb_starts(self) -> Tensor:
        """``(V, T, 2, L, 3)``: shoulders and hips."""
        return self.root[..., None, :] + self.frame[..., self.starts, :]

    def on_spheres(self, ends: Tensor) -> Tensor:
        """Move the ends of limbs to where knees and elbows have the source's angle."""
        starts = self.limb_starts()
        return starts + normalize(ends - starts, dim=-1) * self.bent[..., None]

    def positions(self) -> Tensor:
        """Compute joint positions, (V, T, 2, J, 3) metres, limbs by inverse kinematics."""
        first, second = self.limb_bones()
        bones = self.bones.index_copy(-2, self.middles, first).index_copy(-2, self.ends, second)
        return self.root[..., None, :] + multiply_joints(self.given.below, bones)

    def limb_bones(self) -> tuple[Tensor, Tensor]:
        """Bend the limbs as in the source, turned to where their ends have got."""
        begin, middle, end = (
            self.source[..., j, :] for j in (self.starts, self.middles, self.ends)
        )
        reach = self.targets - self.limb_starts()
        straight = self.upper + self.lower
        soft = soften(reach.norm(dim=-1), self.bent, straight, self.given.holds[..., 0])
        reach = normalize(reach, dim=-1) * soft[..., None]
        pole = turned(middle - (begin + end) / 2, end - begin, reach)
        return two_bone_ik(reach, self.upper, self.lower, normalize(pole, dim=-1))

    def lowest(self) -> Tensor:
        """``(V, T, 2, L)`` metres: height of the lowest joint from a limb's end on, above it."""
        return _lowest(self.frame, self.given.beyond) - self.frame[..., self.ends, 1]

    def stand(self) -> None:
        """Plant the ends that support, and let the root follow."""
        path = hanging_path(
            self.frame, self.source, self.given.beyond, self.ends, self.given.supports
        )
        height = _lowest(self.source, self.given.beyond) - self.lowest()
        supporting = self.given.supports @ (self.given.beyond.numpy().T > 0)
        source_ends = self.source[..., self.ends, :]
        planted = self.targets
        for _ in range(FOLLOWING_STEPS):
            moved = self.targets - source_ends - path
            correction = planted_corrections(
                moved, height - self.targets[..., 1], supporting, self.given.fps
            )
            planted = self.targets + correction
            holds = self.given.holds
            shift = (holds * correction).sum(dim=-2) / (holds.sum(dim=-2) + 1e-3)
            shift = shift * shift.new_tensor([0.0, 1.0, 0.0])  # legs turn about their feet
            self.root = self.root + shift
            self.targets = self.targets + shift[..., None, :]
        self.targets = planted
        stood = self.root
        for _ in range(REACHING_STEPS):
            self.follow(self.root - stood)

    def follow(self, moved: Tensor) -> None:
        """Move the root to where limbs that support reach; others keep the angle of their joint.

        What is left, as where one leg is longer, turns the bones into the limbs' starts: hips tilt.
        """
        holds, before = self.given.holds, self.limb_starts()
        shift = reach_ends(self.targets - before, self.bent, holds[..., 0], moved)
        self.root = self.root + smoothed(shift, SMOOTHING_SECONDS * self.given.fps)
        reach = self.targets - self.limb_starts()
        missing = reach - normalize(reach, dim=-1) * self.bent[..., None]
        given = smoothed(holds * missing, SMOOTHING_SECONDS * self.given.fps)
        bones = self.bones[..., self.starts, :]
        turned_bones = normalize(bones + given, dim=-1) * bones.norm(dim=-1, keepdim=True)
        self.bones = self.bones.index_copy(-2, self.starts, turned_bones)
        self.frame = multiply_joints(self.given.below, self.bones)
        self.targets = self.targets + (1 - holds) * (self.limb_starts() - before)

    def settle(self, kept: Tensor) -> None:
        """Limbs that neither support nor touch keep their angle; nothing is below the floor."""
        sphere = self.on_spheres(self.targets)
        targets = torch.lerp(sphere, self.targets, kept.expand_as(self.targets))
        floor = self.source[..., 1].amin(dim=(0, 2))[:, None] - self.lowest()
        height = targets[..., 1].maximum(floor)
        self.targets = torch.stack([targets[..., 0], height, targets[..., 2]], dim=-1)

    def touch(self) -> None:
        """Close what touched in the source."""
        touches, holds = self.given.touches, self.given.holds
        self.settle(holds.maximum(touches.near_limbs))
        common = common_scale(self.source - self.source[..., self.given.parents, :], self.scales)
        for _ in range(TOUCHING_STEPS):
            apart = touches.missing(self.positions(), common)
            change = smoothed(touches.half(apart), TOUCHING_SMOOTHING * self.given.fps)
            self.targets = self.targets - (1 - holds) * change
        self.settle(holds.maximum(touches.near_limbs))


def _lowest(positions: Tensor, beyond: Tensor) -> Tensor:
    """``(..., L)`` metres: the lowest of each limb's joints from its end on, of (..., J, 3)."""
    heights = positions[..., None, :, 1].expand(*positions.shape[:-2], *beyond.shape)
    return heights.masked_fill(beyond == 0, torch.inf).amin(dim=-1)


def bent_length(first: Tensor, second: Tensor, upper: Tensor, lower: Tensor) -> Tensor:
    """Length of a limb from start to end, whose bones have other lengths and the same angle.

    Parameters
    ----------
    first, second : (..., 3), metres: the source's bones
    upper, lower : (...), metres: the new lengths

    Returns
    -------
    (...), metres
    """
    cosine = (normalize(first, dim=-1) * normalize(second, dim=-1)).sum(dim=-1)
    return (upper**2 + lower**2 + 2 * upper * lower * cosine).clamp_min(0).sqrt()


def soften(reach: Tensor, bent: Tensor, straight: Tensor, holds: Tensor) -> Tensor:
    """Shorten reaches beyond a limb's own, so that it straightens gradually; all are (...), metres.

    The angle of a joint of a limb that gets straight changes as the square root of what is missing:
    without this an elbow snaps within a frame. Limbs that support are not shortened.
    """
    room = (straight - bent).clamp_min(1e-6)
    beyond = (reach - bent).clamp_min(0)
    return reach - (1 - holds) * (beyond - room * (1 - (-beyond / room).exp()))


def turned(vectors: Tensor, axis: Tensor, to: Tensor) -> Tensor:
    """Turn vectors (..., 3) by the smallest rotation that takes one axis to another.

    Axes of opposite directions have no smallest rotation: then the vectors are reflected.
    """
    first, second = normalize(axis, dim=-1), normalize(to, dim=-1)
    half = first + second
    square = half.square().sum(dim=-1, keepdim=True).clamp_min(MIN_SQUARE)
    # Reflection in the plane perpendicular to the first axis, then to the bisector.
    along = (vectors * first).sum(dim=-1, keepdim=True)
    mirrored = vectors - 2 * along * first
    return mirrored - 2 * (mirrored * half).sum(dim=-1, keepdim=True) / square * half


def common_scale(bones: Tensor, scales: Tensor) -> Tensor:
    """Scale that both bodies have in common, (V, 1, 1, 1), as ``interaction_mesh.scene`` has it.

    Parameters
    ----------
    bones : (T, 2, J, 3), metres, of the source
    scales : (V, 2, J)
    """
    lengths = bones.norm(dim=-1).mean(dim=0)
    means = (scales * lengths).sum(dim=-1) / lengths.sum(dim=-1)
    three = torch.cat([means, torch.ones_like(means[:, :1])], dim=1)
    return three.median(dim=1).values[:, None, None, None]


def smoothed(values: Tensor, deviation: float) -> Tensor:
    """Filter ``(V, T, ...)`` over time by a Gaussian of ``deviation`` frames."""
    return torch.from_numpy(gaussian_filter1d(values.numpy(), deviation, axis=1, mode="nearest"))
