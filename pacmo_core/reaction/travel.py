"""Bursts of travel: a body that covers a way in a few frames is given more time.

A generator's body waits and then shoots to its place: its samples differ in when people set out,
and exact times are learnt last. Where the root is faster over the floor than any captured one, the
way is spread over the frames around the burst, so many that its peak is within the limit. The body
moves as a whole; feet that slide then take steps.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from pacmo_core.reaction.turns import smooth_step

Array = NDArray[np.float64]

SMOOTHING = 0.08  # seconds, standard deviation of the filter on the root's path
MAX_BURSTS = 8
NO_LIMIT = 100.0  # metres per second, which nobody reaches
PEAK = 1.5  # of ``smooth_step``, relative to the mean speed
MARGIN = 0.97  # of the limit, at which a way is spread


def peak_speed(root: Array, fps: float) -> float:
    """Metres per second: the largest speed over the floor of a path ``(T, 3)``, smoothed."""
    return float(_speeds(root, fps).max())


def slow_down(root: Array, fps: float, limit: float) -> Array:
    """``(T, 3)`` metres over the floor, from a path to one that is hardly faster than a limit.

    Parameters
    ----------
    root : (T, 3) metres, y up
    fps : frames per second
    limit : metres per second

    Returns
    -------
    (T, 3); zeros where the path is slow enough
    """
    path = root.astype(np.float64)
    for _ in range(MAX_BURSTS):
        speeds = _speeds(path, fps)
        if speeds.max() <= limit:
            break
        way = path[_window(path, speeds, fps, MARGIN * limit)]
        share = smooth_step(np.linspace(0, 1, len(way)))[:, None]
        way[:] = way[0] + share * (way[-1] - way[0])
    return np.asarray((path - root) * [1, 0, 1])


def _window(path: Array, speeds: Array, fps: float, limit: float) -> slice:
    """Return the frames about the fastest in which the way can be spread."""
    fastest, n_frames = int(speeds.argmax()), len(path)
    first, last = fastest, fastest
    for reach in range(1, n_frames):
        first, last = max(fastest - reach, 0), min(fastest + reach, n_frames - 1)
        way = float(np.linalg.norm((path[last] - path[first])[[0, 2]]))
        if PEAK * way * fps <= limit * (last - first):
            break
    return slice(first, last + 1)


def _speeds(path: Array, fps: float) -> Array:
    """``(T,)`` metres per second over the floor, of the smoothed path ``(T, 3)``."""
    if len(path) < 2:
        return np.zeros(len(path))
    smooth = gaussian_filter1d(
        path[:, [0, 2]].astype(np.float64), SMOOTHING * fps, axis=0, mode="nearest"
    )
    return np.asarray(np.linalg.norm(np.gradient(smooth, 1 / fps, axis=0), axis=-1))
