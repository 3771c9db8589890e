"""Which feet stand in which frames.

A foot that stands does not move; a generated one glides a little. A threshold on its speed would
break a stance at every frame of noise, so states last: the Viterbi algorithm (Viterbi 1967) finds
the states of both feet whose cost, in metres, is least. A standing foot costs its displacement, a
moving foot a little for every second, and so does a body that no foot supports, more; a change of
state costs a constant.
"""

from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from pacmo_core.data.interaction import Motion
from pacmo_core.data.segments import feet
from pacmo_core.data.skeleton import Skeleton

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SMOOTHING = 0.08  # seconds, standard deviation of the filter on the ankles' paths
MOVING_COST = 0.15  # metres per second: a slower foot stands
FLIGHT_COST = 0.6  # metres per second, if no foot stands: then the slower of two faster ones stands
CHANGE_COST = 0.05  # metres
LEVEL = (
    0.1  # metres over the lower foot, up to which the height of a foot that stands costs nothing
)
HEIGHT_COST = 3.0  # per second, of the height beyond
# Metres that a foot may glide until it takes a step, and the time of the step: one place for a
# longer glide would lean the body over it.
MAX_GLIDE, STEP_SECONDS = 0.5, 0.2


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
    paths = motion[:, ankles].astype(np.float64)
    over = paths[..., 1] - paths[..., 1].min(axis=1, keepdims=True)
    displacement = _displacement(paths, fps) + HEIGHT_COST / fps * np.maximum(over - LEVEL, 0)
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
