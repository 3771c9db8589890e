"""Post-processing of a reaction, its finish: exact bones, planted feet, floor, closed contacts.

A generator writes joint positions, whose bones change by a few per cent, whose feet glide and whose
hands stop short of the partner's. One solve of the whole clip, with the partner fixed, changes the
motion g to the motion x that minimises

    sum_j w_j |x_j - g_j|^2 + w_a |D^2 (x - g)|^2        the motion and its accelerations
    + w_s sum |x_foot - a|^2                             feet in stance, at the mean place a
    + w_f sum |min(y_foot - floor, 0)|^2                 feet below the floor
    + w_c sum |max(|x_i - y_j| - d, 0)|^2                predicted contacts (``contacts``)

subject to bones of the person's own lengths, their medians over the clip, or of lengths that are
given: then the motion first gets that body where it stands (``body.with_body``). It is solved by
projective dynamics (Bouaziz et al. 2014, *Projective dynamics: fusing constraint projections for
fast simulation*), with the bones' multipliers of ADMM (Overby et al. 2017, *ADMM projective
dynamics*): the projections on floor, contacts and bones change from one iteration to the next, the
matrix does not, and is factorised once. Last, bones are set from the root outwards, so that their
lengths are exact.

Weights are per frame and D^2 is in seconds, so the result depends little on the frame rate.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain, combinations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve_banded, cholesky_banded

from pacmo_core.data.interaction import Motion
from pacmo_core.data.segments import feet, segments
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.finish.avoidance import avoid_partner
from pacmo_core.finish.balance import keep_over_feet
from pacmo_core.finish.body import TargetBody, body_of, is_plausible, with_body
from pacmo_core.finish.bones import (
    lengths_by_joint,
    median_lengths,
    resized,
    set_bone_lengths,
    set_legs,
)
from pacmo_core.finish.contacts import Contacts, predict_contacts
from pacmo_core.finish.floor import MAX_ROLL, find_aloft, find_floor, rest_heights, set_down
from pacmo_core.finish.heights import straighten
from pacmo_core.finish.learnt import Learnt
from pacmo_core.finish.stance import Mask, find_stance, footholds, frame_runs
from pacmo_core.finish.steps import take_steps
from pacmo_core.finish.travel import spread_bursts
from pacmo_core.finish.trunk import shape_trunk, trunk_joints, trunk_size
from pacmo_core.finish.turns import resolve_turns
from pacmo_core.finish.twitches import damp_twitches

Array = NDArray[np.float64]

# Weights of squared metres a frame, relative to that of a trunk's joint, which is 1. Elbows, knees
# and ends of limbs are lighter: they follow what the hand or the foot must do.
HINGE_WEIGHT, LIMB_WEIGHT = 0.4, 0.1
ACCELERATION_WEIGHT = 1e-4  # s^4
BONE_WEIGHT, STANCE_WEIGHT, FLOOR_WEIGHT, CONTACT_WEIGHT = 100.0, 400.0, 100.0, 30.0
N_ITERATIONS = 20
MAX_FLOAT = 0.2  # metres over the floor, up to which a body that no foot carries is set on it
FLOOR_MARGIN = 0.02  # metres above the floor, below which a foot is kept from going through it
STENCIL = (1.0, -2.0, 1.0)  # of the second difference
# Longer motions are solved in parts that overlap.
PART_FRAMES, OVERLAP_FRAMES = 2048, 256


@dataclass(frozen=True)
class Targets:
    """What the solve wants of the joints beside the motion itself.

    Parameters
    ----------
    lengths : (E,) metres, of the bones
    anchor : (T, J, 3) metres, where feet in stance stand, and the heights of others that carry the
        body (``rests``); zeros elsewhere
    stands : (T, J) 1 for the joints of feet in stance, else 0
    rests : (T, J) 1 for the joints of feet that carry the body, moving or not, else 0
    floor : (T, J) metres, height below which a joint must not be; -inf for all but feet
    contacts : Contacts
    """

    lengths: Array
    anchor: Array
    stands: Array
    rests: Array
    floor: Array
    contacts: Contacts

    def frames(self, first: int, end: int) -> "Targets":
        """Select frames ``first`` to ``end``, exclusive."""
        part, contacts = slice(first, end), self.contacts
        rows = (contacts.frame >= first) & (contacts.frame < end)
        within = Contacts(*(values[rows] for values in vars(contacts).values()))
        shifted = Contacts(**{**vars(within), "frame": within.frame - first})
        return Targets(
            self.lengths,
            self.anchor[part],
            self.stands[part],
            self.rests[part],
            self.floor[part],
            shifted,
        )


def finish(
    reaction: Motion,
    partner: Motion,
    times: NDArray[np.float64],
    skeleton: Skeleton,
    learnt: Learnt,
    body: TargetBody | None = None,
) -> Motion:
    """Return the reaction with exact bones, planted feet and closed contacts.

    Parameters
    ----------
    reaction, partner : (T, J, 3) float32, metres, in the world, y up
    times : (T,) float64, seconds
    skeleton : of both people
    learnt : Learnt
    body : of the person who reacts; None for the reaction's own, or the partner's if the own is of
        another size (``is_plausible``). Contacts are those that the generated body predicts

    Returns
    -------
    (T, J, 3) float32, metres

    Notes
    -----
    The order: the body as a whole is mended (``calmed``); contacts are predicted from it, as the
    generated heights of its hands tell of them; it is set on the floor and upright, which moves the
    hands; it takes whole steps, whose stances need the right height; it gets another's bones, if
    asked; feet get places, which need steps and bones; the root is kept over them. Then all targets
    are solved for at once, and bones are set to their lengths, which the solver only nears.
    """
    fps = float(1 / np.median(np.diff(times))) if len(times) > 1 else 1.0
    calm = calmed(reaction, partner, fps, skeleton, learnt)
    own = median_lengths(calm.astype(np.float32), skeleton)
    if body is None and not is_plausible(own, median_lengths(partner, skeleton), skeleton):
        body = body_of(partner, skeleton)
    # Before the body is moved to its height: a fist that just reaches would no longer.
    contacts = predict_contacts(calm.astype(np.float32), partner, fps, skeleton, learnt.contacts)
    tolerance = float(learnt.floor_tolerance)
    aloft = find_aloft(calm.astype(np.float32), fps, skeleton) & bool(learnt.leaves_floor)
    standing = set_down(calm, partner, fps, skeleton, tolerance, aloft)
    upright = straighten(standing, own, fps, skeleton, learnt.heights)
    stepping = take_steps(upright, own, fps, skeleton).astype(np.float32)
    if body is not None:
        ground = _ground(stepping, fps, skeleton)
        stepping = with_body(stepping.astype(np.float64), body, ground, skeleton).astype(np.float32)
    wanted = own if body is None else body.lengths
    stance = find_stance(stepping, fps, skeleton) & ~aloft
    floor = rest_heights(stepping, partner, stance, fps, skeleton, tolerance)
    motion = stepping.astype(np.float64)
    anchor, stands = find_footholds(motion, wanted, stance, floor, fps, skeleton)
    placed = np.where(stands[..., None] > 0, anchor, motion)
    motion = keep_over_feet(motion, placed, stance, wanted, fps, skeleton)
    rests = _support(motion, anchor, stands, floor, skeleton, aloft)
    targets = Targets(wanted, anchor, stands, rests, floor, contacts)
    result = np.zeros_like(motion)
    for first, end, share in _parts(len(motion)):
        part = Solver(motion[first:end], targets.frames(first, end), fps, skeleton).solve()
        result[first:end] += share[:, None, None] * part
    exact = set_bone_lengths(result, targets.lengths, skeleton)
    set_legs(exact, result, targets.floor, targets.lengths, skeleton)
    return exact.astype(np.float32)


def calmed(
    reaction: Motion, partner: Motion, fps: float, skeleton: Skeleton, learnt: Learnt
) -> Array:
    """Mend a body as a whole, before its contacts, feet and bones; the first part of a finish.

    Trunks that collapse turn about and get their shape, the body goes no faster than captured ones,
    does not twitch, and goes round the partner.

    Parameters
    ----------
    reaction, partner : (T, J, 3) float32, metres, y up
    fps : frames per second
    skeleton : of both people
    learnt : of which contacts, heights and floors are not used

    Returns
    -------
    (T, J, 3) float64, metres
    """
    turned = resolve_turns(reaction.astype(np.float64), fps, skeleton)
    shaped = shape_trunk(turned, skeleton, learnt.trunk)
    even = spread_bursts(shaped, fps, skeleton, learnt.max_speeds)
    smooth = damp_twitches(even, fps, learnt.max_accelerations)
    return avoid_partner(smooth, partner, fps, skeleton, float(learnt.least_distance))


def find_footholds(
    motion: Array, lengths: Array, stance: Mask, floor: Array, fps: float, skeleton: Skeleton
) -> tuple[Array, Array]:
    """Find where feet stand: ``anchor`` and ``stands`` of ``Targets``.

    Parameters
    ----------
    motion : (T, J, 3) metres, of a body whose bones get ``lengths``, (E,)
    stance : (F, T) of ``stance.find_stance``
    floor : (T, J) metres, of ``floor.rest_heights``
    fps : frames per second
    skeleton : of the motion
    """
    anchor, stands = np.zeros_like(motion), np.zeros(motion.shape[:2])
    length_of = lengths_by_joint(lengths, skeleton)
    for number, (foot, standing) in enumerate(zip(feet(skeleton), stance, strict=True)):
        joints, share = list(foot), 1 / (1 + number % 2)
        places = [
            footholds(motion[:, foot[0]], phase, fps, share) for phase in frame_runs(standing)
        ]
        for phase in chain.from_iterable(places):
            path = motion[phase][:, joints]
            place = path.mean(axis=0)
            # A foot may roll, but is on the floor for half of the time that it stands.
            above = path[..., 1] - np.median(path[..., 1] - floor[phase][:, joints], axis=0)
            anchor[phase, joints] = place
            lowest = floor[phase][:, joints]
            anchor[phase, joints, 1] = np.clip(above, lowest, lowest + MAX_ROLL)
            stands[phase, joints] = 1
            for joint in joints[1:]:
                parent = skeleton.parents[joint]
                _set_length(anchor[phase], parent, joint, length_of[joint])
    return anchor, stands


def _ground(motion: Motion, fps: float, skeleton: Skeleton) -> Array:
    """``(T,)`` metres: the height of the ground beneath a body; without legs its lowest joint."""
    if not feet(skeleton):
        return np.full(len(motion), float(motion[..., 1].min()))
    floor = find_floor(motion, find_stance(motion, fps, skeleton), skeleton)
    return floor.at(motion[:, skeleton.root].astype(np.float64))


def _support(
    motion: Array, anchor: Array, stands: Array, floor: Array, skeleton: Skeleton, aloft: Mask
) -> Array:
    """Let the lower foot carry a body that stands on none and is not aloft; ``rests``, (T, J).

    Sets the heights of ``anchor`` in place.
    """
    rests = stands.copy()
    if not feet(skeleton):
        return rests
    ankles = np.array([foot[0] for foot in feet(skeleton)])
    above = motion[:, ankles, 1] - floor[:, ankles]
    floats = ~stands[:, ankles].any(axis=1) & (above.min(axis=1) < MAX_FLOAT) & ~aloft
    for number, foot in enumerate(feet(skeleton)):
        frames = np.ix_(floats & (above.argmin(axis=1) == number), list(foot))
        rests[frames] = 1
        anchor[..., 1][frames] = floor[frames]
    return rests


def _set_length(motion: Array, parent: int, joint: int, length: float) -> None:
    """Move a joint over the ground, in its direction from its parent, to a distance of it."""
    bone = motion[:, joint] - motion[:, parent]
    flat = np.linalg.norm(bone[:, [0, 2]], axis=-1)
    wanted = np.sqrt(np.maximum(length**2 - bone[:, 1] ** 2, 0))
    scale = wanted / np.maximum(flat, 1e-9)
    motion[:, joint, 0] = motion[:, parent, 0] + scale * bone[:, 0]
    motion[:, joint, 2] = motion[:, parent, 2] + scale * bone[:, 2]


class FrameFinish:
    """The part of a finish that needs no later frames: trunk, exact bones, no feet below the floor.

    The bones keep the lengths that they have in the first frames; a foot below the floor is
    raised to it. Planted feet and contacts need the frames that follow: whether a foot begins to
    stand, and where, and whether a hand approaches, is known only then.

    Parameters
    ----------
    first : (S, T, J, 3) metres, of S reactions
    partner : (J, 3) metres, a pose that stands on the floor
    skeleton : of both
    learnt : Learnt
    """

    def __init__(self, first: Motion, partner: Motion, skeleton: Skeleton, learnt: Learnt) -> None:
        self.skeleton, self.trunk_model = skeleton, learnt.trunk
        self.sizes = [trunk_size(motion.astype(np.float64), skeleton) for motion in first]
        shaped = [
            self._shape(motion.astype(np.float64), size).astype(np.float32)
            for motion, size in zip(first, self.sizes, strict=True)
        ]
        self.lengths = [median_lengths(motion, skeleton) for motion in shaped]
        tolerance = float(learnt.floor_tolerance)
        both_stand = np.ones((len(feet(skeleton)), 1), bool)
        floors = [
            rest_heights(motion[-1:], partner[None], both_stand, 1.0, skeleton, tolerance)[0]
            for motion in shaped
        ]
        self.floor = np.array(floors)

    def __call__(self, poses: Motion) -> Motion:
        """Finish the poses ``(S, J, 3)`` of one frame."""
        bodies = zip(poses.astype(np.float64), self.sizes, self.lengths, self.floor, strict=True)
        result = []
        for pose, size, lengths, floor in bodies:
            exact = set_bone_lengths(self._shape(pose[None], size)[0], lengths, self.skeleton)
            set_legs(exact, exact.copy(), floor, lengths, self.skeleton)
            result.append(exact)
        return np.stack(result).astype(np.float32)

    def _shape(self, motion: Array, size: float) -> Array:
        return shape_trunk(motion, self.skeleton, self.trunk_model, size)


class Solver:
    """The solve of one clip: a factorisation for the horizontal axes and one for the vertical.

    Parameters
    ----------
    motion : (T, J, 3) metres
    targets : of the same frames
    fps : frames per second
    skeleton : of the motion
    """

    def __init__(self, motion: Array, targets: Targets, fps: float, skeleton: Skeleton) -> None:
        self.motion, self.targets = motion, targets
        links = np.concatenate([skeleton.bones, _struts(skeleton)])
        self.incidence = np.zeros((len(links), motion.shape[1]))  # from joints to links
        self.incidence[range(len(links)), links[:, 0]] = -1
        self.incidence[range(len(links)), links[:, 1]] = 1
        self.lengths = np.linalg.norm(
            self.incidence @ set_bone_lengths(motion, targets.lengths, skeleton), axis=-1
        )
        shape = motion.shape[:2]
        contacts = targets.contacts
        pull = np.zeros(shape)
        np.add.at(pull, (contacts.frame, contacts.joint), CONTACT_WEIGHT * contacts.strength)
        self.on_floor = motion[..., 1] < targets.floor + FLOOR_MARGIN
        smooth = ACCELERATION_WEIGHT * fps**4
        position = np.tile(position_weights(skeleton), (shape[0], 1))
        horizontal = position + pull + STANCE_WEIGHT * targets.stands
        vertical = position + pull + FLOOR_WEIGHT * self.on_floor + STANCE_WEIGHT * targets.rests
        self.factors = [
            cholesky_banded(_banded(weights, smooth, links), lower=True, check_finite=False)
            for weights in (horizontal, vertical)
        ]
        self.constant = position[..., None] * motion + smooth * _fourth_difference(motion)
        held = np.stack([targets.stands, targets.rests, targets.stands], axis=-1)
        self.constant += STANCE_WEIGHT * held * targets.anchor

    def solve(self) -> Array:
        """Return the motion ``(T, J, 3)``; its bones are nearly, not exactly, of their lengths."""
        x, multiplier = self.motion, np.zeros((len(self.motion), len(self.incidence), 3))
        for _ in range(N_ITERATIONS):
            right = self.constant.copy()
            vectors = self.incidence @ x + multiplier
            projected = resized(vectors, self.lengths)
            multiplier = vectors - projected
            wanted = BONE_WEIGHT * (projected - multiplier)
            right += self.incidence.T @ wanted
            self._add_contacts(right, x)
            lifted = np.maximum(x[..., 1], self.targets.floor)
            right[..., 1] += np.where(self.on_floor, FLOOR_WEIGHT * lifted, 0)
            x = self._solve(right)
        return x

    def _add_contacts(self, right: Array, x: Array) -> None:
        contacts = self.targets.contacts
        offset = x[contacts.frame, contacts.joint] - contacts.point
        distance = np.linalg.norm(offset, axis=-1)
        scale = contacts.distance / np.maximum(distance, np.maximum(contacts.distance, 1e-9))
        wanted = contacts.point + scale[:, None] * offset
        weight = CONTACT_WEIGHT * contacts.strength[:, None]
        np.add.at(right, (contacts.frame, contacts.joint), weight * wanted)

    def _solve(self, right: Array) -> Array:
        flat, x = right.reshape(-1, 3), np.zeros((self.motion[..., 0].size, 3))
        for factor, axes in zip(self.factors, ([0, 2], [1]), strict=True):
            x[:, axes] = cho_solve_banded((factor, True), flat[:, axes], check_finite=False)
        return x.reshape(right.shape)


def position_weights(skeleton: Skeleton) -> Array:
    """``(J,)``: weight of each joint's position; all 1 if limbs have no names."""
    weights = np.ones(len(skeleton.joints))
    for joint, segment in zip(skeleton.bones[:, 1].tolist(), segments(skeleton), strict=True):
        if segment.kind in ("upper_arm", "thigh"):
            weights[joint] = HINGE_WEIGHT
        elif segment.part in ("arm", "leg", "foot"):
            weights[joint] = LIMB_WEIGHT
    return weights


def _struts(skeleton: Skeleton) -> NDArray[np.intp]:
    """``(S, 2)``: pairs of joints of the trunk that no bone joins; they keep its shape."""
    bones = {frozenset(bone) for bone in skeleton.bones.tolist()}
    pairs = combinations(trunk_joints(skeleton), 2)
    struts = [pair for pair in pairs if frozenset(pair) not in bones]
    return np.array(struts, dtype=np.intp).reshape(-1, 2)


def _banded(weights: Array, smooth: float, links: NDArray[np.intp]) -> Array:
    """Return the lower bands of the matrix of one axis, ``(2 J + 1, T J)``, frame by frame."""
    n_frames, n_joints = weights.shape
    bands = np.zeros((2 * n_joints + 1, n_frames, n_joints))
    bands[0] = weights
    for lag, values in enumerate(_fourth_difference_bands(n_frames)):
        bands[lag * n_joints] += smooth * values[:, None]
    for first, second in links.tolist():
        bands[0, :, [first, second]] += BONE_WEIGHT
        bands[abs(first - second), :, min(first, second)] -= BONE_WEIGHT
    flat = bands.reshape(len(bands), -1)
    return flat[: flat.shape[1]]


def _fourth_difference_bands(n_frames: int) -> Array:
    """``(3, T)``: the bands of D'D, D the second difference between neighbouring frames."""
    bands, n_rows = np.zeros((3, n_frames)), max(n_frames - 2, 0)
    for row in range(3):
        for column in range(row + 1):
            bands[row - column, column : column + n_rows] += STENCIL[row] * STENCIL[column]
    return bands


def _fourth_difference(motion: Array) -> Array:
    """Return D'D of a motion, ``(T, J, 3)``."""
    second = np.diff(motion, n=2, axis=0)
    result = np.zeros_like(motion)
    for offset, factor in enumerate(STENCIL):
        result[offset : offset + len(second)] += factor * second
    return result


def _parts(n_frames: int) -> Iterator[tuple[int, int, Array]]:
    """Yield the first frame and the end, exclusive, of overlapping parts, and frames' shares."""
    first = 0
    while True:
        end = n_frames if n_frames - first <= PART_FRAMES + OVERLAP_FRAMES else first + PART_FRAMES
        share = np.ones(end - first)
        fade = (np.arange(OVERLAP_FRAMES) + 0.5) / OVERLAP_FRAMES
        if first:
            share[:OVERLAP_FRAMES] = fade
        if end < n_frames:
            share[-OVERLAP_FRAMES:] = 1 - fade
        yield first, end, share
        if end == n_frames:
            return
        first = end - OVERLAP_FRAMES
