"""The floor on which two people stand, and a body that is set down on it.

A floor is a plane: a camera that is tilted by a degree shows it 2 cm higher at a distance of 1 m.
It is fitted to the places where a person stands, by least squares with a prior on its slope, since
somebody who stays in one place says nothing of it. Joints of the feet are within the body: their
heights over the floor are in proportion to the legs, so those of a child are lower than those of an
adult on the same floor.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, median_filter

from pacmo_core.data.interaction import Motion
from pacmo_core.data.segments import feet
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.finish.bones import leg_length, median_lengths
from pacmo_core.finish.stance import Mask, find_stance, frame_runs

Array = NDArray[np.float64]

# Height of an ankle over the leg's length: .039 over .491 of the stature (Winter 2009, fig. 4.1).
ANKLE_SHARE = 0.08
# Metres, standard deviation of the height at which a foot is seen to stand: depth sensors place two
# feet on one floor 5 cm apart, which is no slope.
HEIGHT_SPREAD = 0.03
SAME_PLACE = 0.15  # metres between the places of two phases of a foot, up to which they are one
SLOPE_SPREAD = 0.025  # standard deviation of the floor's slope, that of a camera's tilt
LOW_QUANTILE = 0.05  # of a foot's heights, below which it stands if it never stays in a place
# Metres between the heights at which two captured people stand, beyond which they are not on one
# floor: more than captures err, and less than a chair.
FLOOR_TOLERANCE = 0.25
ONE_FLOOR = 100.0  # tolerance where no two captured people stand apart
MAX_APART = 0.02  # share of captures whose two people seem to stand apart that may be errors
CLEARLY_WORSE = 0.01  # metres by which the partner's floor errs more than the generated one's
MIN_FLOORS = 4  # reactions, of fewer nothing is learnt
# Metres over the floor that the lower foot reaches in a flight; and the share of captured frames in
# flights from which on generated bodies may leave the floor too: more than a depth sensor errs (3 %
# of the frames of SBU, where nobody jumps).
ALOFT_HEIGHT, MIN_ALOFT = 0.15, 0.04
MAX_FLOAT = 0.15  # metres over the lowest heights of the feet, above which a foot does not stand
MAX_ROLL = 0.04  # metres over the floor, up to which a joint of a foot that stands may rise
SMOOTHING = 0.08  # seconds, standard deviation of the filter on the times at which a foot stands
# Seconds over which the height of the lower foot is a body's own height: longer than feet leave the
# floor; and standard deviation of the filter on it.
DRIFT_SECONDS, DRIFT_SMOOTHING = 1.5, 0.2


@dataclass(frozen=True)
class Floor:
    """A plane, and where the joints of a person's feet rest over it.

    Parameters
    ----------
    origin : (2,) metres, x and z
    height : metres, of the plane at the origin
    slope : (2,) of the plane along x and z
    rest : (K,) metres over the plane, of an ankle and of the joints beyond it
    leg : metres, length of the legs of the same person
    """

    origin: Array
    height: float
    slope: Array
    rest: Array
    leg: float

    def at(self, points: Array) -> Array:
        """``(...)`` metres: the plane's height under points ``(..., 3)``."""
        under: Array = self.height + (points[..., [0, 2]] - self.origin) @ self.slope
        return under

    def of(self, leg: float) -> Array:
        """``(K,)`` metres over the plane at which the feet of a person with such legs rest."""
        return self.rest * (leg / self.leg)


def find_floor(motion: Motion, stance: Mask, skeleton: Skeleton) -> Floor:
    """Fit the floor to the feet that stand.

    Parameters
    ----------
    motion : (T, J, 3) metres, y up
    stance : (F, T) of ``stance.find_stance``
    skeleton : of the motion, with feet
    """
    places, levels = _standing_joints(motion.astype(np.float64), stance, skeleton)
    origin = places[:, [0, 2]].mean(axis=0)
    n_levels = int(levels.max()) + 1
    rows = np.hstack([np.eye(n_levels)[levels], places[:, [0, 2]] - origin]) / HEIGHT_SPREAD
    prior = np.hstack([np.zeros((2, n_levels)), np.eye(2) / SLOPE_SPREAD])
    wanted = np.concatenate([places[:, 1] / HEIGHT_SPREAD, [0, 0]])
    found = np.linalg.lstsq(np.vstack([rows, prior]), wanted, rcond=None)[0]
    leg = leg_length(median_lengths(motion, skeleton), skeleton)
    height = found[0] - ANKLE_SHARE * leg
    return Floor(origin, float(height), found[n_levels:], found[:n_levels] - height, leg)


def _standing_joints(motion: Array, stance: Mask, skeleton: Skeleton) -> tuple[Array, Mask]:
    """Return the mean places of the joints of feet, each time that one stands, and their levels.

    Returns
    -------
    (N, 3) metres, (N,) indices: 0 for an ankle, 1 for the joint after it and so on
    """
    ankles = motion[:, [foot[0] for foot in feet(skeleton)], 1]
    low = np.quantile(ankles, LOW_QUANTILE, axis=0)
    places: list[Array] = []
    levels: list[int] = []
    for foot, standing, heights, lowest in zip(feet(skeleton), stance, ankles.T, low, strict=True):
        if lowest > low.min() + MAX_FLOAT:  # held up, or not tracked
            continue
        grounded = standing & (heights < low.min() + MAX_FLOAT)
        phases = frame_runs(grounded if grounded.any() else heights <= lowest)
        for place in _mean_places(motion[:, list(foot)], phases):
            places += list(place)
            levels += range(len(foot))
    return np.array(places), np.array(levels)


def _mean_places(foot: Array, phases: list[slice]) -> list[Array]:
    """Return the mean places ``(K, 3)`` of the joints of a foot, each time that it stands.

    Noise breaks a stance: phases that follow each other in one place are one, not as many
    measurements of the floor.
    """
    groups: list[list[Array]] = []
    for phase in phases:
        poses = foot[phase]
        at = poses[:, 0, [0, 2]].mean(axis=0)
        if groups and np.linalg.norm(at - groups[-1][-1][:, 0, [0, 2]].mean(axis=0)) < SAME_PLACE:
            groups[-1].append(poses)
        else:
            groups.append([poses])
    return [np.concatenate(group).mean(axis=0) for group in groups]


def floor_errors(
    generated: Motion, captured: Motion, partner: Motion, fps: float, skeleton: Skeleton
) -> Array:
    """``(2,)`` metres: the floors of a generated body and of the partner, over the captured one."""
    floors = [find_floor(m, find_stance(m, fps, skeleton), skeleton) for m in (generated, partner)]
    real = find_floor(captured, find_stance(captured, fps, skeleton), skeleton)
    place = np.array([real.origin[0], 0, real.origin[1]])
    return np.array([floor.at(place) - real.height for floor in floors])


def learn_floor_tolerance(errors: Array) -> float:
    """Learn how far the floors of two people may be apart to be one, metres.

    In most captures the two stand on one floor, and the partner's is better known than that of a
    generated body, however far that is from it: a body that is generated too low beside a partner
    who lies is raised. Where some captured people stand on a chair, a body that is generated on one
    stays there. A capture that places each person's floor by itself, wrongly, teaches that each
    stands on its own.

    Parameters
    ----------
    errors : (N, 2) of ``floor_errors``, of reactions to held-out partners
    """
    if len(errors) < MIN_FLOORS:
        return ONE_FLOOR
    distances = np.abs(errors)
    of_generated, of_partner = np.median(distances, axis=0)
    if of_partner > of_generated + CLEARLY_WORSE:
        return 0.0
    apart = (distances[:, 1] > FLOOR_TOLERANCE).mean()
    return FLOOR_TOLERANCE if apart > MAX_APART else ONE_FLOOR


def find_aloft(motion: Motion, fps: float, skeleton: Skeleton) -> Mask:
    """``(T,)``: in which frames both feet are off the floor, as in a jump or carried by the other.

    Parameters
    ----------
    motion : (T, J, 3) metres, y up
    fps : frames per second
    skeleton : of the motion; without feet no frame is
    """
    if not feet(skeleton):
        return np.zeros(len(motion), dtype=np.bool_)
    aloft = np.zeros(len(motion), dtype=np.bool_)
    for flight in _flights(motion, fps, skeleton):
        aloft[flight] = True
    return aloft


def _flights(motion: Motion, fps: float, skeleton: Skeleton) -> list[slice]:
    """List the runs of frames in which both feet are off the floor, by more than a step."""
    floor = find_floor(motion, find_stance(motion, fps, skeleton), skeleton)
    ankles = motion[:, [foot[0] for foot in feet(skeleton)]].astype(np.float64)
    lower = (ankles[..., 1] - floor.at(ankles) - floor.rest[0]).min(axis=1)
    return [run for run in frame_runs(lower > MAX_ROLL) if lower[run].max() > ALOFT_HEIGHT]


def rest_heights(
    reaction: Motion,
    partner: Motion,
    stance: Mask,
    fps: float,
    skeleton: Skeleton,
    tolerance: float,
) -> Array:
    """``(T, J)`` metres: the heights at which the joints of the feet rest; -inf for all others.

    Both people stand on one floor, that of the partner, unless the reaction's own is far from it.

    Parameters
    ----------
    reaction, partner : (T, J, 3) metres
    stance : (F, T) of the reaction
    fps : frames per second
    skeleton : of both
    tolerance : metres, of ``learn_floor_tolerance``
    """
    heights = np.full(reaction.shape[:2], -np.inf)
    if not feet(skeleton):
        return heights
    own = find_floor(reaction, stance, skeleton)
    floor = _shared_floor(own, partner, fps, skeleton, tolerance)
    for foot in feet(skeleton):
        for joint, rest in zip(foot, floor.rest, strict=False):
            heights[:, joint] = floor.at(reaction[:, joint].astype(np.float64)) + rest
    return heights


def set_down(
    motion: Array,
    partner: Motion,
    fps: float,
    skeleton: Skeleton,
    tolerance: float,
    aloft: Mask,
) -> Array:
    """Set a body on the floor of its partner, and on it each foot that stands.

    A body that is too low, throughout or for seconds, would be raised by its feet alone later, and
    squat. A foot that stands in the air, as in the mean of kicks with the left and the right, would
    draw the body, and the foot that kicks, down to the floor.

    Parameters
    ----------
    motion : (T, J, 3) metres, y up
    partner : (T, J, 3) metres
    fps : frames per second
    skeleton : of both
    tolerance : metres, of ``learn_floor_tolerance``
    aloft : (T,) frames in which no foot is set down

    Returns
    -------
    (T, J, 3) metres
    """
    if not feet(skeleton):
        return motion
    result, body = motion.copy(), motion.astype(np.float32)
    stance = find_stance(body, fps, skeleton) & ~aloft
    own = find_floor(body, stance, skeleton)
    floor = _shared_floor(own, partner, fps, skeleton, tolerance)
    root = motion[:, skeleton.root]
    drift = _drift(motion, own, fps, skeleton, aloft)
    result[..., 1] += (floor.at(root) - own.at(root) - drift)[:, None]
    rests = rest_heights(result.astype(np.float32), partner, stance, fps, skeleton, tolerance)
    ankles = result[:, [foot[0] for foot in feet(skeleton)], 1].T
    lower = (ankles == ankles.min(axis=0)) & ~stance.any(axis=0) & ~aloft
    for run in _flights(body, fps, skeleton):
        if not aloft[run].any():
            # The mean of two kicks raises both feet: one carries the body, the other kicks.
            carrier = int(ankles[:, run].mean(axis=1).argmin())
            lower[:, run] = np.arange(len(ankles))[:, None] == carrier
            stance[:, run] = False
            _stay(result, run, list(feet(skeleton)[carrier]))
    for foot, carries in zip(feet(skeleton), stance | lower, strict=True):
        share = gaussian_filter1d(carries.astype(np.float64), SMOOTHING * fps, mode="nearest")
        over = np.maximum(result[:, foot[0], 1] - rests[:, foot[0]] - MAX_ROLL, 0)
        result[:, list(foot), 1] -= (share * over)[:, None]
    return result


def _stay(motion: Array, run: slice, joints: list[int]) -> None:
    """Move joints over the ground straight from where they are before some frames to after them."""
    before, after = max(run.start - 1, 0), min(run.stop, len(motion) - 1)
    share = np.linspace(0, 1, after - before + 1)[:, None, None]
    ends = motion[[before, after]][:, joints][..., [0, 2]]
    path = (1 - share) * ends[0] + share * ends[1]
    for column, axis in enumerate((0, 2)):
        motion[before : after + 1, joints, axis] = path[..., column]


def _drift(motion: Array, floor: Floor, fps: float, skeleton: Skeleton, aloft: Mask) -> Array:
    """``(T,)`` metres: height of the lower foot over its floor, its median over some time."""
    if aloft.all():
        return np.zeros(len(motion))
    ankles = motion[:, [foot[0] for foot in feet(skeleton)]]
    lower = (ankles[..., 1] - floor.at(ankles) - floor.rest[0]).min(axis=1)
    frames = np.arange(len(motion))
    lower = np.interp(frames, frames[~aloft], lower[~aloft])
    usual = median_filter(lower, 2 * round(DRIFT_SECONDS / 2 * fps) + 1, mode="nearest")
    return np.asarray(gaussian_filter1d(usual, DRIFT_SMOOTHING * fps, mode="nearest"))


def _shared_floor(
    own: Floor, partner: Motion, fps: float, skeleton: Skeleton, tolerance: float
) -> Floor:
    """Return the floor of the partner under the person, or their own where they are far apart.

    The lowest joint of a foot rests as high as the partner's. The others are over it as they are in
    the person's own feet: toes that the partner's skeleton places lower would point down.
    """
    floor = find_floor(partner, find_stance(partner, fps, skeleton), skeleton)
    place = np.array([own.origin[0], 0, own.origin[1]])
    if abs(floor.at(place) - own.height) > tolerance:
        return own
    lowest = floor.of(own.leg).min() - own.rest.min()
    return replace(floor, height=floor.height + float(lowest), rest=own.rest, leg=own.leg)
