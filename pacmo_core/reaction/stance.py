"""Which feet stand in which frames, and the floor on which they stand.

A foot that stands does not move; a generated one glides a little. A threshold on its speed would
break a stance at every frame of noise, so states last: the Viterbi algorithm (Viterbi 1967) finds
the states of both feet whose cost, in metres, is least. A standing foot costs its displacement, a
moving foot a little for every second, and so does a body that no foot supports, more; a change of
state costs a constant.

A floor is a plane: a camera that is tilted by a degree shows it 2 cm higher at a distance of 1 m.
It is fitted to the places where a person stands, by least squares with a prior on its slope, since
somebody who stays in one place says nothing of it. Joints of the feet are within the body: their
heights over the floor are in proportion to the legs, so those of a child are lower than those of an
adult on the same floor.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from pacmo_core.data.interaction import Motion
from pacmo_core.data.segments import feet
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.reaction.bones import leg_length, median_lengths

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SMOOTHING = 0.08  # seconds, standard deviation of the filter on the ankles' paths
MOVING_COST = 0.15  # metres per second: a slower foot stands
FLIGHT_COST = 0.6  # metres per second, if no foot stands: then the slower of two faster ones stands
CHANGE_COST = 0.05  # metres
# Metres that a foot may glide until it takes a step, and the time of the step: one place for a
# longer glide would lean the body over it.
MAX_GLIDE, STEP_SECONDS = 0.5, 0.2
# Height of an ankle over the leg's length: .039 over .491 of the stature (Winter 2009, fig. 4.1).
ANKLE_SHARE = 0.08
HEIGHT_SPREAD = 0.01  # metres, standard deviation of the height at which a foot is seen to stand
SLOPE_SPREAD = 0.025  # standard deviation of the floor's slope, that of a camera's tilt
LOW_QUANTILE = 0.05  # of a foot's heights, below which it stands if it never stays in a place


def find_stance(motion: Motion, fps: float, skeleton: Skeleton) -> Mask:
    """``(F, T)``: in which frames each of ``segments.feet`` stands.

    Parameters
    ----------
    motion : (T, J, 3) metres
    fps : frames per second
    skeleton : of the motion; without feet F is 0
    """
    ankles = [foot[0] for foot in feet(skeleton)]
    if not ankles:
        return np.zeros((0, len(motion)), dtype=np.bool_)
    displacement = _displacement(motion[:, ankles].astype(np.float64), fps)
    states = np.array(list(product((False, True), repeat=len(ankles))))
    supported = states.any(axis=1)
    cost = displacement @ states.T + MOVING_COST / fps * (~states).sum(axis=1)
    cost += np.where(supported, 0, FLIGHT_COST / fps)
    change = CHANGE_COST * (states[:, None] != states).sum(axis=2)
    return states[_shortest_path(cost, change)].T


def frame_runs(mask: Mask) -> list[slice]:
    """List the runs of frames in which a mask (T,) is true, as those in which a foot stands."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]])))
    return [slice(first, end) for first, end in edges.reshape(-1, 2).tolist()]


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
    places: list[Array] = []
    levels: list[int] = []
    for foot, standing in zip(feet(skeleton), stance, strict=True):
        heights = motion[:, foot[0], 1]
        low = np.flatnonzero(heights <= np.quantile(heights, LOW_QUANTILE))
        for phase in frame_runs(standing) if standing.any() else [low]:
            places += list(motion[phase][:, list(foot)].mean(axis=0))
            levels += range(len(foot))
    return np.array(places), np.array(levels)


def footholds(path: Array, phase: slice, fps: float, share: float) -> list[slice]:
    """Divide the frames in which a foot stands where it glides too far for one place.

    Parameters
    ----------
    path : (T, 3) metres, of the ankle
    phase : frames in which it stands
    fps : frames per second
    share : of ``MAX_GLIDE``, for the first place: feet that glide together then step in turn

    Returns
    -------
    the frames of each place, with ``STEP_SECONDS`` from one to the next
    """
    smooth = gaussian_filter1d(path[:, [0, 2]], SMOOTHING * fps, axis=0, mode="nearest")
    half = max(1, round(STEP_SECONDS * fps / 2))
    found, start, frame, most = [], phase.start, phase.start, share * MAX_GLIDE
    while frame < phase.stop:
        if np.linalg.norm(smooth[frame] - smooth[start]) > most:
            found.append(slice(start, max(frame - half, start + 1)))
            start, most = min(frame + half, phase.stop - 1), MAX_GLIDE
            frame = start
        frame += 1
    return [*found, slice(start, phase.stop)]


def _displacement(paths: Array, fps: float) -> Array:
    """``(T, F)`` metres that the smoothed paths ``(T, F, 3)`` move in a frame, over the ground."""
    smooth = gaussian_filter1d(paths[..., [0, 2]], SMOOTHING * fps, axis=0, mode="nearest")
    steps = np.linalg.norm(np.diff(smooth, axis=0), axis=-1)
    if not len(steps):
        return np.zeros(paths.shape[:2])
    padded = np.concatenate([steps[:1], steps, steps[-1:]])
    mean: Array = (padded[1:] + padded[:-1]) / 2
    return mean


def _shortest_path(cost: Array, change: Array) -> NDArray[np.intp]:
    """Return the states ``(T,)`` of least total cost.

    Parameters
    ----------
    cost : (T, S) of each state in each frame
    change : (S, S) of a change from a state (rows) to another
    """
    total, previous = cost[0], np.zeros(cost.shape, dtype=np.intp)
    for frame in range(1, len(cost)):
        reached = total[:, None] + change
        previous[frame] = reached.argmin(axis=0)
        total = reached.min(axis=0) + cost[frame]
    path = np.zeros(len(cost), dtype=np.intp)
    path[-1] = total.argmin()
    for frame in range(len(cost) - 1, 0, -1):
        path[frame - 1] = previous[frame, path[frame]]
    return path
