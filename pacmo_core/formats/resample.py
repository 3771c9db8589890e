"""Resample motions at another frame rate and rotate them to another upward axis, for export."""

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

from pacmo_core.data.interaction import Motion
from pacmo_core.data.limits import MAX_POSITIONS
from pacmo_core.formats.base import check_fps, check_up

_SPLINE_DEGREE = 3
UNEVEN = 1e-3  # of the median step, by which steps vary that are not of one rate


def frame_rate(times: NDArray[np.float64]) -> float:
    """Return the frames a second: the inverse of the usual time between two frames or more.

    It is the median step; where steps vary, as of times that are rounded, the mean of all steps,
    into as many of which as it is nearest to a longer one is divided.
    """
    steps = np.diff(times)
    step = float(np.median(steps))
    if np.ptp(steps) > UNEVEN * step:
        for _ in range(2):  # the median of rounded steps may be a third too short
            step = float(steps.sum() / np.rint(steps / step).clip(1).sum())
    return 1 / step


def sample_times(times: NDArray[np.float64], fps: float) -> NDArray[np.float64]:
    """List the sample times of a frame rate from the first frame on, up to the last frame's time.

    Raises
    ------
    ValueError
        If the rate is not plausible, or the clip is too short for two frames of it.
    """
    check_fps(fps)
    # A hundredth of a frame: times of a file are rounded.
    count = int((times[-1] - times[0]) * fps + 0.01) + 1
    if count > MAX_POSITIONS:
        raise ValueError(f"wanted at most {MAX_POSITIONS} frames; got {count} at {fps:g} fps")
    if count < 2:
        raise ValueError(f"{times[-1] - times[0]:g} s are too short for two frames at {fps:g} fps")
    # A file's frame rate is rounded, and so the last time may be after the last frame's.
    at: NDArray[np.float64] = np.minimum(times[0] + np.arange(count) / fps, times[-1])
    return at


def resample(motion: Motion, times: NDArray[np.float64], at: NDArray[np.float64]) -> Motion:
    """Resample a motion by a cubic spline through its frames.

    Frames whose time is kept are equal to float32 precision. A clip of fewer than four frames has a
    spline of lower degree.

    Parameters
    ----------
    motion : (T, J, 3) float32, metres
    times : (T,) float64, seconds, rising
    at : (N,) float64, seconds, within ``times``
    """
    spline = make_interp_spline(
        times, motion.astype(np.float64), k=min(_SPLINE_DEGREE, len(times) - 1)
    )
    resampled: Motion = spline(at.clip(times[0], times[-1])).astype(np.float32)
    return resampled


def with_missing(times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the times of frames ``(T,)`` and of those that are missing between them, ``(N,)``.

    Frames are missing where the next one comes later by 1.5 or more of the usual step; so many as
    divide that time most nearly into such steps.

    Raises
    ------
    ValueError
        If more are missing than a motion may have.
    """
    if len(times) < 3:
        return times
    steps = np.diff(times)
    counts = np.rint(steps * frame_rate(times)).clip(1)
    if counts.sum() > MAX_POSITIONS:
        pause, start = steps.max(), times[steps.argmax()]
        raise ValueError(
            f"wanted at most {MAX_POSITIONS} frames; {pause:g} s without any after {start:g} s are "
            f"{counts.max():g} at {frame_rate(times):g} fps"
        )
    counts = counts.astype(int)
    parts = [np.linspace(start, start + step, count, endpoint=False)
             for start, step, count in zip(times[:-1], steps, counts, strict=True)]  # fmt: skip
    return np.append(np.concatenate(parts), times[-1])


def from_y_up(motion: Motion, up: str) -> Motion:
    """Rotate ``(..., 3)`` from y up to another upward axis: the inverse of ``base.to_y_up``.

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
