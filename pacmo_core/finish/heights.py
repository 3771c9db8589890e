"""Heights of the pelvis: a body that crouches where people do not is straightened.

A generator's pelvis drifts up and down by centimetres, and exact bones turn that into knees: it
squats. The height of the pelvis over the lower foot, relative to the legs, becomes the one that is
expected of captured motion, given the generated one: an isotonic regression of medians, as the mean
of those who stand and those who crouch is a height at which nobody is. Where generated heights say
nothing of the captured ones that is the captured median; where they do, as of people who sit down
or fall, those who are low stay low. Feet stay where they are.
"""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import isotonic_regression

from pacmo_core.data.segments import feet
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.finish.bones import leg_joints, leg_length, set_bone_lengths, set_legs

Array = NDArray[np.float64]

N_GROUPS = 25  # of generated heights of one size, of each of which the captured median is taken
MIN_FRAMES = 50  # of which heights are learnt
SMOOTHING = 0.08  # seconds, standard deviation of the filter on the change of height
SLACK = 0.01  # of the legs' length, of ``set_legs``


def no_change() -> Array:
    """``(2, K)``: the model of heights that changes none."""
    return np.zeros((2, N_GROUPS))


def pelvis_heights(motion: Array, lengths: Array, skeleton: Skeleton) -> Array:
    """``(T,)``: height of the root over the lower ankle, by the legs' length; of two feet or more.

    Parameters
    ----------
    motion : (T, J, 3) metres, y up
    lengths : (E,) metres, of the bones
    skeleton : of the motion
    """
    ankles = [foot[0] for foot in feet(skeleton)]
    over = motion[:, skeleton.root, 1] - motion[:, ankles, 1].min(axis=1)
    return np.asarray(over / leg_length(lengths, skeleton), dtype=np.float64)


def learn_heights(pairs: Iterable[tuple[Array, Array]]) -> Array:
    """Learn the expected captured height of the pelvis for a generated one.

    Parameters
    ----------
    pairs : (T,) of generated reactions, and of the captured reaction to the same partner at the
        same times, of ``pelvis_heights``

    Returns
    -------
    (2, K): generated heights, the medians of groups, and the captured ones to expect
    """
    both = list(pairs)
    if sum(len(generated) for generated, _ in both) < MIN_FRAMES:
        return no_change()
    generated, captured = (np.concatenate(heights) for heights in zip(*both, strict=True))
    groups = np.array_split(np.argsort(generated, kind="stable"), N_GROUPS)
    places, medians = (
        np.array([np.median(heights[group]) for group in groups])
        for heights in (generated, captured)
    )
    return np.stack([places, isotonic_regression(medians).x])


def straighten(
    motion: Array, lengths: Array, fps: float, skeleton: Skeleton, height_model: Array
) -> Array:
    """Move a body above its feet so that its pelvis is as high as captured ones are.

    Parameters
    ----------
    motion : (T, J, 3) metres, y up
    lengths : (E,) metres, of the bones
    fps : frames per second
    skeleton : of the motion
    height_model : of ``learn_heights``

    Returns
    -------
    (T, J, 3) metres
    """
    if not height_model.any() or not feet(skeleton):
        return motion
    heights = pelvis_heights(motion, lengths, skeleton)
    change = (np.interp(heights, *height_model) - heights) * leg_length(lengths, skeleton)
    rise = gaussian_filter1d(change, SMOOTHING * fps, mode="nearest")
    legs = leg_joints(skeleton)
    moved = motion.copy()
    moved[..., 1] += rise[:, None]
    exact = set_bone_lengths(moved, lengths, skeleton)
    set_legs(exact, motion, np.full(motion.shape[:2], -np.inf), lengths, skeleton, SLACK)
    moved[:, legs] = exact[:, legs]
    return moved
