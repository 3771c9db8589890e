"""Post-processing of retargeted pairs, their finish: joint angles, feet and touches are set right.

Another algorithm than that of reactions (``pacmo_core/finish``), which have no source to keep to.

A network comes near the solver's motion, and near is visible: a knee gives by some degrees, a foot
that stands glides by a centimetre, a hand stops short of the shoulder that it held. The finish
changes a pair of motions on given bodies by what the source says of them, by closed forms and few
iterations, without any weight that is learnt.

1. **Bones and angles.** Every bone takes its length. Hands and feet keep the direction that they
   have in the source, and knees and elbows their angle: the end of a limb lies on a sphere about
   its start, in the direction in which the network has it.
2. **Stances.** The end of a limb that supports the body keeps its displacement for the whole
   stance, with its lowest joint at the source's height; the root follows, held to its place, and
   hips tilt, so that legs reach at the angle of their knees.
3. **Touches.** Joints of the two people that touch in the source keep their offset: limbs that
   support nothing move towards it from both sides.

Everything turns with a scene that is turned about the vertical, and nothing changes where bodies
and motions are the source's. Shapes: V bodies, T frames, J joints, L limbs; metres.
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
from pacmo_core.interaction_mesh.mesh import support_steps, support_weights
from pacmo_core.skeleton_prior.kinematics import (
    KinematicOutput,
    Limb,
    multiply_joints,
    perpendicular_part,
    two_bone_ik,
)
from pacmo_core.skeleton_prior.start import squared_distances

# Times that the root follows the feet and the feet's places the root.
FOLLOWING_STEPS = 4
# Times that the filtered root is moved to where limbs reach.
REACHING_STEPS = 6
# Seconds in which what holds a limb's end that supports fades in and out.
FADE_SECONDS = 0.25
# Seconds, standard deviation of the filter on what the root is moved by.
SMOOTHING_SECONDS = 0.1
# Seconds without support that do not end a stance: the displacement from the source stays.
MAX_GAP = 0.2
# Metres over the source's height at which a foot may stand: the solver, too, lifts feet of smaller
# bodies by as much where hands touch.
MAX_LIFT = 0.015
# Iterations that find the root's place, and what holds the root against the limbs' 1.
ROOT_STEPS = 5
ROOT_WEIGHTS = (0.1, 3e-3, 0.1)
# Times that limbs take half of what touches miss.
TOUCHING_STEPS = 8
# Seconds, standard deviation of the filter on each of these steps.
TOUCHING_SMOOTHING = 0.05
# Degrees a second by which knees and elbows that support nothing change at most beside the source.
MAX_BEND_SPEED = 150.0
# Seconds, standard deviation of the filter on the direction in which limbs bend.
POLE_SMOOTHING = 0.1
# Metres between joints of the two people: nearer ones touch, or are near, and have full weight; the
# weight falls to zero at the second distance, so that nothing starts at once.
TOUCHING, APART = 0.1, 0.2
NEAR, FAR = 0.1, 0.4
# Square metres: an axis or pole whose square is less has no direction.
MIN_SQUARE = 1e-12
MIN_REACH = 1e-6  # metres


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
    def kinematics(self) -> KinematicOutput:
        """Forward kinematics of the skeleton."""
        return KinematicOutput(self.skeleton, self.limbs)

    @cached_property
    def poles(self) -> tuple[Tensor, Tensor]:
        """Directions (T, 2, L, 3) in which the source's limbs bend: in each frame, and smoothed.

        A limb that is straight for a moment then points anywhere; smoothed, as before and after.
        """
        begin, middle, end = (self.source[..., j, :] for j in self.kinematics.limbs.T)
        poles = perpendicular_part(middle - begin, normalize(end - begin, dim=-1))
        smooth = smoothed(poles[None], POLE_SMOOTHING * self.fps)[0]
        return normalize(poles, dim=-1), normalize(smooth, dim=-1)

    @cached_property
    def beyond(self) -> Tensor:
        """``(L, J)`` float32: 1 at a limb's end and at the joints beyond it."""
        return self.kinematics.ancestor_matrix[:, self.kinematics.limbs[:, 2]].T

    @cached_property
    def touches(self) -> "_Touches":
        """What touches in the source."""
        return _Touches(self.source, self.beyond)

    @cached_property
    def supporting(self) -> NDArray[np.bool_]:
        """``(T, 2, L)``: whether a limb's end, or a joint beyond it, supports."""
        result: NDArray[np.bool_] = self.supports @ (self.beyond.numpy().T > 0)
        return result

    @cached_property
    def holds(self) -> Tensor:
        """``(T, 2, L, 1)``: 1 where a limb's end supports, fading to 0 before and after."""
        rows = self.supporting.reshape(len(self.supporting), -1)
        held = support_weights(rows, self.fps, FADE_SECONDS).reshape(self.supporting.shape)
        return torch.tensor(held, dtype=torch.float32)[..., None]


class _Bodies:
    """The bodies while they are finished: the root, the ends of limbs, the bones between others."""

    def __init__(self, finish: Finish, motions: Tensor, scales: Tensor) -> None:
        self.given, self.source = finish, finish.source
        kinematics = finish.kinematics
        self.starts, self.middles, self.ends = kinematics.limbs.T
        source_bones = kinematics.bone_vectors(self.source)
        lengths = source_bones.norm(dim=-1) * scales[:, None]
        self.common = common_scale(source_bones, scales)
        hangs = finish.beyond.sum(dim=0) > 0
        hangs[self.ends] = False
        bones = torch.where(hangs[:, None], source_bones, kinematics.bone_vectors(motions))
        self.bones = normalize(bones, dim=-1) * lengths[..., None]
        self.root = motions[..., kinematics.root, :]
        self.upper, self.lower = lengths[..., self.middles], lengths[..., self.ends]
        self.bent = bent_length(source_bones[..., self.middles, :], source_bones[..., self.ends, :],
                                self.upper, self.lower)  # fmt: skip
        self.frame = self.from_root(self.bones)  # limbs apart
        ends = motions[..., self.ends, :]
        self.targets = torch.lerp(
            self.on_spheres(ends), ends, finish.touches.near_limbs.expand_as(ends)
        )

    def from_root(self, bones: Tensor) -> Tensor:
        """Apply forward kinematics, without the root's position."""
        return multiply_joints(self.given.kinematics.ancestor_matrix, bones)

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
        return self.root[..., None, :] + self.from_root(bones)

    def limb_bones(self) -> tuple[Tensor, Tensor]:
        """Bend the limbs as in the source, turned to where their ends have got.

        What a limb bends more than in the source, it bends in the smoothed direction: a straight
        one has none of its own.
        """
        begin, end = (self.source[..., j, :] for j in (self.starts, self.ends))
        reach = self.targets - self.limb_starts()
        straight = self.upper + self.lower
        holds = self.given.holds[..., 0]
        soft = soften(reach.norm(dim=-1), self.bent, straight, holds)
        soft = self.without_snaps(soft, holds)
        reach = normalize(reach, dim=-1) * soft[..., None]
        as_source, smooth = self.given.poles
        height = bend_height(self.bent, self.upper, self.lower)
        more = (bend_height(soft, self.upper, self.lower) - height).clamp_min(0)
        pole = height[..., None] * as_source + more[..., None] * smooth
        pole = normalize(turned(pole, end - begin, reach), dim=-1)
        return two_bone_ik(reach, self.upper, self.lower, pole)

    def without_snaps(self, reach: Tensor, holds: Tensor) -> Tensor:
        """Let knees and elbows of limbs that support nothing change from the source's gradually.

        Who reaches for a body of another size would stretch and bend an arm within some frames.
        """
        bend, source = (bend_angle(r, self.upper, self.lower) for r in (reach, self.bent))
        change = bend - source
        slow = slowed(change, np.radians(MAX_BEND_SPEED) / self.given.fps)
        bend = source + torch.lerp(slow, change, holds.expand_as(change))
        cosine = bend.clamp(0, np.pi).cos()
        square = self.upper**2 + self.lower**2 + 2 * self.upper * self.lower * cosine
        limited: Tensor = square.clamp_min(0).sqrt()
        return limited

    def lowest(self) -> Tensor:
        """``(V, T, 2, L)`` metres: height of the lowest joint from a limb's end on, above it."""
        return _lowest(self.frame, self.given.beyond) - self.frame[..., self.ends, 1]

    def stand(self) -> None:
        """Plant the ends that support, and let the root follow."""
        given, holds = self.given, self.given.holds
        source_ends, rolled = self.source[..., self.ends, :], self.rolling()
        height = _lowest(self.source, given.beyond) - self.lowest()
        planted = self.targets
        for _ in range(FOLLOWING_STEPS):
            moved = self.targets - source_ends - rolled
            rises = height - self.targets[..., 1]
            correction = planted_corrections(moved, rises, given.supporting, given.fps)
            planted = self.targets + correction
            shift = (holds * correction).sum(dim=-2) / (holds.sum(dim=-2) + 1e-3)
            shift = shift * shift.new_tensor([0.0, 1.0, 0.0])  # legs turn about their feet
            self.root = self.root + shift
            self.targets = self.targets + shift[..., None, :]
        self.targets = planted
        stood = self.root
        for _ in range(REACHING_STEPS):
            self.follow(self.root - stood)

    def rolling(self) -> Tensor:
        """Horizontal path of a limb's end for which the joints that support do not slide.

        A foot of another length that rolls over its toes moves its ankle differently: (V, T, 2, L,
        3) metres more than in the source, from any place.
        """
        supports = self.given.supports
        steps = torch.from_numpy(support_steps(supports.reshape(len(supports), -1)))
        steps = steps.reshape(-1, *supports.shape[1:]).to(self.frame)  # (T - 1, 2, J)
        path = torch.zeros_like(self.frame[..., self.ends, :])
        for limb, end in enumerate(self.ends.tolist()):
            new, old = (p - p[..., end : end + 1, :] for p in (self.frame, self.source))
            weights = steps * self.given.beyond[limb]
            weights = weights / weights.sum(dim=-1, keepdim=True).clamp_min(1)
            rolled = -(weights[..., None] * (new - old).diff(dim=1)).sum(dim=-2)
            path[:, 1:, :, limb] = rolled.cumsum(dim=1)
        return path * path.new_tensor([1.0, 0.0, 1.0])

    def follow(self, moved: Tensor) -> None:
        """Move the root to where limbs that support reach; others keep the angle of their joint.

        What is left, as where one leg is longer, turns the bones into the limbs' starts: hips tilt.
        """
        holds, before = self.given.holds, self.limb_starts()
        deviation = SMOOTHING_SECONDS * self.given.fps
        shift = reach_ends(self.targets - before, self.bent, holds[..., 0], moved)
        self.root = self.root + smoothed(shift, deviation)
        reach = self.targets - self.limb_starts()
        missing = reach - normalize(reach, dim=-1) * self.bent[..., None]
        bones = self.bones[..., self.starts, :]
        turned_bones = normalize(bones + smoothed(holds * missing, deviation), dim=-1)
        turned_bones = turned_bones * bones.norm(dim=-1, keepdim=True)
        self.bones = self.bones.index_copy(-2, self.starts, turned_bones)
        self.frame = self.from_root(self.bones)
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
        kept = holds.maximum(touches.near_limbs)
        self.settle(kept)
        for _ in range(TOUCHING_STEPS):
            change = touches.half_missing(self.positions(), self.common)
            change = smoothed(change, TOUCHING_SMOOTHING * self.given.fps)
            self.targets = self.targets - (1 - holds) * change
        self.settle(kept)


class _Touches:
    """What touches in a source (T, 2, J, 3): the weights of pairs, of joints and of limbs."""

    def __init__(self, source: Tensor, beyond: Tensor) -> None:
        self.source, self.beyond = source, beyond
        distances = squared_distances(source[:, 0], source[:, 1]).sqrt()
        self.weights = _falling(distances, TOUCHING, APART)  # (T, J, J): of a and b
        sums = torch.stack([self.weights.sum(dim=2), self.weights.sum(dim=1)], dim=1)
        self.sums = sums[..., None]  # (T, 2, J, 1): of each joint's touches together
        # (T, 2, L, 1): 1 where a limb touches the partner, or is near it, from its end on
        self.of_limbs = self._of_limbs(self.weights)
        self.near_limbs = self._of_limbs(_falling(distances, NEAR, FAR))

    def _of_limbs(self, weights: Tensor) -> Tensor:
        largest = torch.stack([weights.amax(dim=2), weights.amax(dim=1)], dim=1)
        return (largest[..., None, :] * self.beyond).amax(dim=-1, keepdim=True)

    def half_missing(self, positions: Tensor, common: Tensor) -> Tensor:
        """Half of the mean change of a limb's offsets to what it touches, faded: (V, T, 2, L, 3).

        Parameters
        ----------
        positions : (V, T, 2, J, 3), metres
        common : (V, 1, 1, 1, 1), by which the offsets are scaled
        """
        a, b = (positions - common * self.source).unbind(dim=2)
        partners = torch.stack([self.weights @ b, self.weights.mT @ a], dim=2)
        missing = self.beyond @ (self.sums * torch.stack([a, b], dim=2) - partners)
        return 0.5 * self.of_limbs * missing / (self.beyond @ self.sums).clamp_min(1e-6)


def planted_corrections(
    displacements: Tensor, rises: Tensor, supporting: NDArray[np.bool_], fps: float
) -> Tensor:
    """Compute what makes displacements constant for a whole stance, and heights what they are.

    In a stance the horizontal displacement becomes its mean, and so does the height over the
    source's, between 0 and ``MAX_LIFT``. The correction is interpolated from one stance to the
    next, and kept before the first and after the last.

    Parameters
    ----------
    displacements : (V, T, 2, L, 3), metres, of the limbs' ends from the source
    rises : (V, T, 2, L), metres by which a limb's end would rise if it stood
    supporting : (T, 2, L)
    fps : frames per second

    Returns
    -------
    (V, T, 2, L, 3), metres, to be added
    """
    corrections = torch.zeros_like(displacements)
    for person, limb in np.ndindex(*supporting.shape[1:]):
        frames = np.flatnonzero(supporting[:, person, limb])
        if not len(frames):
            continue
        breaks = np.flatnonzero(np.diff(frames) > 1 + MAX_GAP * fps) + 1
        stances = [np.arange(s[0], s[-1] + 1) for s in np.split(frames, breaks)]
        frames = np.concatenate(stances)
        own, up = displacements[:, :, person, limb], rises[:, :, person, limb]
        fixed = torch.cat([own[:, s].mean(dim=1, keepdim=True) - own[:, s] for s in stances], dim=1)
        fixed[..., 1] = torch.cat(
            [up[:, s] - up[:, s].mean(dim=1, keepdim=True).clamp(-MAX_LIFT, 0) for s in stances],
            dim=1,
        )
        places = np.interp(np.arange(len(supporting)), frames, np.arange(len(frames)))
        before = np.floor(places).astype(int)
        after = np.minimum(before + 1, len(frames) - 1)
        share = _smooth_step(torch.tensor(places - before).to(own)[:, None])
        corrections[:, :, person, limb] = torch.lerp(fixed[:, before], fixed[:, after], share)
    return corrections


def reach_ends(offsets: Tensor, lengths: Tensor, weights: Tensor, moved: Tensor) -> Tensor:
    """Find the shift of the root with which limbs reach their ends at given lengths.

    Weighted least squares of the lengths, by Gauss-Newton; a limb is asked for its length only, so
    that it may turn about its end.

    Parameters
    ----------
    offsets : (V, T, 2, L, 3), metres, from each limb's start to its end
    lengths : (V, T, 2, L), metres
    weights : (T, 2, L)
    moved : (V, T, 2, 3), metres by which the root has been moved already

    Returns
    -------
    (V, T, 2, 3), metres
    """
    shift = torch.zeros_like(offsets[..., 0, :])
    held = torch.diag(offsets.new_tensor(ROOT_WEIGHTS))
    for _ in range(ROOT_STEPS):
        left = offsets - shift[..., None, :]
        distances = left.norm(dim=-1)
        directions = normalize(left, dim=-1)
        weighted = weights[..., None] * directions
        pull = (weighted * (distances - lengths)[..., None]).sum(dim=-2)
        pull = pull - (moved + shift) @ held
        shift = shift + torch.linalg.solve(weighted.mT @ directions + held, pull)
    return shift


def bent_length(first: Tensor, second: Tensor, upper: Tensor, lower: Tensor) -> Tensor:
    """Length (...) of a limb whose bones get lengths (...) and keep the angle of bones (..., 3)."""
    cosine = (normalize(first, dim=-1) * normalize(second, dim=-1)).sum(dim=-1)
    return (upper**2 + lower**2 + 2 * upper * lower * cosine).clamp_min(0).sqrt()


def bend_height(reach: Tensor, upper: Tensor, lower: Tensor) -> Tensor:
    """Distance (...) of a limb's middle from the line between its ends, which are (...) apart."""
    reach = reach.clamp_min(MIN_REACH)
    along = (upper**2 - lower**2 + reach**2) / (2 * reach)
    return (upper**2 - along**2).clamp_min(0).sqrt()


def bend_angle(reach: Tensor, upper: Tensor, lower: Tensor) -> Tensor:
    """Angle (...) in radians between the bones of a limb whose ends are (...) metres apart."""
    cosine = (reach**2 - upper**2 - lower**2) / (2 * upper * lower).clamp_min(MIN_SQUARE)
    return cosine.clamp(-1, 1).acos()


def slowed(values: Tensor, step: float) -> Tensor:
    """Values (V, T, ...) that change by at most ``step`` from a frame to the next.

    The mean of the least such values above them and the greatest below: where values are slow
    enough both are the values themselves, and elsewhere a change begins as early as it ends late.
    """
    envelopes, frames = torch.stack([values, -values]), 1
    while frames < values.shape[1]:
        before, fall = envelopes, frames * step
        envelopes = before.clone()
        for to, of in (
            (slice(frames, None), slice(-frames)),
            (slice(-frames), slice(frames, None)),
        ):
            envelopes[:, :, to] = envelopes[:, :, to].maximum(before[:, :, of] - fall)
        frames *= 2
    return (envelopes[0] - envelopes[1]) / 2


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
    """Scale that both bodies have in common, as ``interaction_mesh.scene`` has it.

    Of bones (T, 2, J, 3), metres, of the source, and scales (V, 2, J): (V, 1, 1, 1, 1).
    """
    lengths = bones.norm(dim=-1).mean(dim=0)
    means = (scales * lengths).sum(dim=-1) / lengths.sum(dim=-1)
    three = torch.cat([means, torch.ones_like(means[:, :1])], dim=1)
    return three.median(dim=1).values[:, None, None, None, None]


def smoothed(values: Tensor, deviation: float) -> Tensor:
    """Filter ``(V, T, ...)`` over time by a Gaussian of ``deviation`` frames."""
    return torch.from_numpy(gaussian_filter1d(values.numpy(), deviation, axis=1, mode="nearest"))


def _lowest(positions: Tensor, beyond: Tensor) -> Tensor:
    """``(..., L)`` metres: the lowest of each limb's joints from its end on, of (..., J, 3)."""
    heights = positions[..., None, :, 1].expand(*positions.shape[:-2], *beyond.shape)
    return heights.masked_fill(beyond == 0, torch.inf).amin(dim=-1)


def _falling(distances: Tensor, full: float, none: float) -> Tensor:
    """Weigh distances: 1 up to the first, smoothly 0 from the second on."""
    return _smooth_step(((none - distances) / (none - full)).clamp(0, 1))


def _smooth_step(share: Tensor) -> Tensor:
    """Go from 0 to 1, at rest at either end."""
    return share**2 * (3 - 2 * share)
