"""Bursts: a body that covers a way, or turns, in a few frames is given more time.

A generator's body waits and then shoots to its place, or spins: its samples differ in when people
set out, and exact times are learnt last. Where the root is faster over the floor, or the body turns
faster, than any captured one, the way is spread over the frames around the burst, so many that its
peak is within the limit. The body moves as a whole; feet that slide then take steps.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.finish.turns import find_headings, smooth_step, turned

Array = NDArray[np.float64]

SMOOTHING = 0.08  # seconds, standard deviation of the filter on a path
MAX_BURSTS = 8
NO_LIMIT = 100.0  # metres or radians per second, which nobody reaches
PEAK = 1.5  # of ``smooth_step``, relative to the mean speed
MARGIN = 0.97  # of the limit, at which a way is spread


def peak_speeds(motion: Array, fps: float, skeleton: Skeleton) -> Array:
    """``(2,)`` metres and radians per second: the fastest that a body travels, and that it turns.

    Parameters
    ----------
    motion : (T, J, 3) metres, y up
    fps : frames per second
    skeleton : of the motion
    """
    paths = motion[:, skeleton.root, [0, 2]], find_headings(motion, None, skeleton)[:, None]
    return np.array([_speeds(path, fps).max() for path in paths])


def spread_bursts(motion: Array, fps: float, skeleton: Skeleton, max_speeds: Array) -> Array:
    """Slow a body that travels or turns faster than the limits; one within them is unchanged.

    Parameters
    ----------
    motion : (T, J, 3) metres, y up
    fps : frames per second
    skeleton : of the motion
    max_speeds : (2,) of ``peak_speeds``

    Returns
    -------
    (T, J, 3) metres
    """
    travel, turn = max_speeds.tolist()
    headings = find_headings(motion, None, skeleton)
    more = slow_down(headings[:, None], fps, turn)[:, 0]
    root = motion[:, skeleton.root]
    place = root.copy()
    place[:, [0, 2]] += slow_down(root[:, [0, 2]], fps, travel)
    if not more.any() and np.array_equal(place, root):
        return motion
    return np.asarray(place[:, None] + turned(motion - root[:, None], more))


def slow_down(path: Array, fps: float, limit: float) -> Array:
    """``(T, D)``: what changes a path into one that is hardly faster than a limit.

    Parameters
    ----------
    path : (T, D) metres or radians
    fps : frames per second
    limit : metres or radians per second

    Returns
    -------
    (T, D); zeros where the path is slow enough
    """
    slower = path.astype(np.float64)
    for _ in range(MAX_BURSTS):
        speeds = _speeds(slower, fps)
        if speeds.max() <= limit:
            break
        way = slower[_window(slower, speeds, fps, MARGIN * limit)]
        share = smooth_step(np.linspace(0, 1, len(way)))[:, None]
        way[:] = way[0] + share * (way[-1] - way[0])
    return slower - path


def _window(path: Array, speeds: Array, fps: float, limit: float) -> slice:
    """Return the frames about the fastest in which the way can be spread."""
    fastest, n_frames = int(speeds.argmax()), len(path)
    first, last = fastest, fastest
    for reach in range(1, n_frames):
        first, last = max(fastest - reach, 0), min(fastest + reach, n_frames - 1)
        way = float(np.linalg.norm(path[last] - path[first]))
        if PEAK * way * fps <= limit * (last - first):
            break
    return slice(first, last + 1)


def _speeds(path: Array, fps: float) -> Array:
    """``(T,)`` per second, of the smoothed path ``(T, D)``."""
    if len(path) < 2:
        return np.zeros(len(path))
    smooth = gaussian_filter1d(path.astype(np.float64), SMOOTHING * fps, axis=0, mode="nearest")
    return np.asarray(np.linalg.norm(np.gradient(smooth, 1 / fps, axis=0), axis=-1))
