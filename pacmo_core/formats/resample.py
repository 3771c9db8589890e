"""Motions at other instants, on other axes, in other units: what tools outside ask for."""

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

from pacmo_core.data.interaction import Motion
from pacmo_core.formats.people import check_fps, check_up

_DEGREE = 3


def instants(times: NDArray[np.float64], fps: float) -> NDArray[np.float64]:
    """List the instants of a rate from the first frame on, the last frame's included if it fits.

    Raises
    ------
    ValueError
        If no capture has such a rate, or the clip is too short for two frames of it.
    """
    check_fps(fps)
    # A hundredth of a frame: times of a file are rounded.
    count = int((times[-1] - times[0]) * fps + 0.01) + 1
    if count < 2:
        raise ValueError(f"{times[-1] - times[0]:g} s are too short for two frames at {fps:g} fps")
    at: NDArray[np.float64] = times[0] + np.arange(count) / fps
    return at


def resampled(motion: Motion, times: NDArray[np.float64], at: NDArray[np.float64]) -> Motion:
    """Move a motion to other instants by a cubic spline through its frames.

    Frames that stay are the same to float32's precision. A clip of fewer than four frames has a
    spline of lower degree.

    Parameters
    ----------
    motion : (T, J, 3) float32, metres
    times : (T,) float64, seconds, rising
    at : (N,) float64, seconds, within ``times``
    """
    spline = make_interp_spline(times, motion.astype(np.float64), k=min(_DEGREE, len(times) - 1))
    moved: Motion = spline(at.clip(times[0], times[-1])).astype(np.float32)
    return moved


def turned_to(motion: Motion, up: str) -> Motion:
    """Turn ``(..., 3)`` from y up to an axis of the choice: undoes ``people.upright``.

    Raises
    ------
    ValueError
        If ``up`` is neither ``y`` nor ``z``.
    """
    check_up(up)
    if up == "y":
        return motion
    x, y, z = np.moveaxis(motion, -1, 0)
    return np.stack((x, -z, y), axis=-1)
