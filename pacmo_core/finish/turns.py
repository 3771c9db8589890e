"""Turns that a generator averaged: a body that collapses while it turns, turned about as a whole.

Somebody who turns round may do so to the left or to the right. The mean of both has no width: hips
and shoulders shrink to a point and come out on the other side, in a few frames. Such a collapse is
seen in the distances between left and right joints of the trunk. Over it the heading goes from that
before to that after the shorter way round, at the speed of a captured turn, and the body, in the
shape that it has before and after, is turned about the vertical through its root.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from pacmo_core.data.segments import trunk_pairs
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.finish.stance import frame_runs

Array = NDArray[np.float64]

SMOOTHING = 0.08  # seconds, standard deviation of the filter on the trunk's joints
# Widths of the trunk over their medians: a body below the first has collapsed, from and until the
# second. Captured turns stay above 0.8.
COLLAPSED, WHOLE = 0.6, 0.85
TURN_SPEED = 3.5  # radians per second, where there is time: the peak of captured turns


def find_headings(motion: Array, fps: float | None, skeleton: Skeleton) -> Array:
    """``(T,)`` radians about the vertical, continuous; zeros if the trunk has no pairs of joints.

    Parameters
    ----------
    motion : (T, J, 3) metres, y up
    fps : frames per second, of which the headings are smoothed; None for those of each frame
    skeleton : of the motion
    """
    across = _across(motion, fps, skeleton).sum(axis=1)
    return np.unwrap(np.arctan2(across[:, 0], across[:, 2]))


def turned(vectors: Array, angles: Array) -> Array:
    """Turn vectors ``(T, ..., 3)`` about the vertical by ``(T,)`` radians."""
    shape = (len(angles), *(1,) * (vectors.ndim - 2))
    cosine, sine = np.cos(angles).reshape(shape), np.sin(angles).reshape(shape)
    x, y, z = np.moveaxis(vectors, -1, 0)
    return np.stack([cosine * x + sine * z, y, cosine * z - sine * x], axis=-1)


def resolve_turns(motion: Array, fps: float, skeleton: Skeleton) -> Array:
    """Turn the body about as a whole where it collapses; a motion without collapse is unchanged.

    Parameters
    ----------
    motion : (T, J, 3) metres, y up
    fps : frames per second
    skeleton : of the motion

    Returns
    -------
    (T, J, 3) metres
    """
    collapses = find_collapses(motion, fps, skeleton)
    if not collapses:
        return motion
    own, root = find_headings(motion, fps, skeleton), motion[:, skeleton.root][:, None]
    wanted, shape = own.copy(), turned(motion - root, -own)
    for number, collapse in enumerate(collapses):
        before, after = collapse.start - 1, collapse.stop
        if before < 0 or after == len(motion):
            whole = before if before >= 0 else after
            wanted[collapse], shape[collapse] = own[whole], shape[whole]
            continue
        share = (np.arange(before, after + 1) - before) / (after - before)
        share = smooth_step(share)[:, None, None]
        shape[before : after + 1] = (1 - share) * shape[before] + share * shape[after]
        free = slice(
            collapses[number - 1].stop if number else 0,
            collapses[number + 1].start if number + 1 < len(collapses) else len(motion),
        )
        _turn(wanted, before, after, free, fps)
    return np.asarray(root + turned(shape, wanted))


def find_collapses(motion: Array, fps: float, skeleton: Skeleton) -> list[slice]:
    """List the frames of each collapse of the trunk, in order, apart from one another.

    Parameters
    ----------
    motion : (T, J, 3) metres
    fps : frames per second
    skeleton : of the motion
    """
    widths = np.linalg.norm(_across(motion, fps, skeleton), axis=-1).sum(axis=1)
    ratio = widths / max(float(np.median(widths)), 1e-9)
    return [
        run
        for run in frame_runs(ratio < WHOLE)
        if ratio[run].min() < COLLAPSED and run.stop - run.start < len(ratio)
    ]


def smooth_step(share: Array) -> Array:
    """Go from 0 to 1 without a jump of speed: ``3 s^2 - 2 s^3``, of slope 1.5 at most."""
    return np.asarray(share**2 * (3 - 2 * share))


def _turn(headings: Array, before: int, after: int, free: slice, fps: float) -> None:
    """Turn from the heading at a frame to that at another, in place; later frames turn with it."""
    difference = headings[after] - headings[before]
    shorter = (difference + np.pi) % (2 * np.pi) - np.pi
    headings[after:] += shorter - difference
    more = max(0, round(1.5 * abs(shorter) / TURN_SPEED * fps) - (after - before)) / 2
    first = max(free.start, round(before - more))
    last = min(free.stop - 1, round(after + more))
    share = smooth_step(np.arange(last - first + 1) / (last - first))
    headings[first : last + 1] = headings[first] + share * (headings[last] - headings[first])


def _across(motion: Array, fps: float | None, skeleton: Skeleton) -> Array:
    """``(T, P, 3)`` metres: from right to left, of each pair of the trunk, smoothed with a rate."""
    pairs = np.array(trunk_pairs(skeleton), dtype=np.intp).reshape(-1, 2)
    gaps = motion[:, pairs[:, 0]].astype(np.float64) - motion[:, pairs[:, 1]]
    if fps is None:
        return gaps
    smooth: Array = gaussian_filter1d(gaps, SMOOTHING * fps, axis=0, mode="nearest")
    return smooth
