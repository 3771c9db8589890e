"""Twitches: a body that jerks as no captured one does is smoothed around that instant.

To a partner who moves as none of the training does, a generator may turn arms or trunk away and
back within two frames. Where a joint accelerates more than that joint of any captured body, the
whole body is smoothed over the frames around, again until it does not: a joint alone would leave
its limb.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, maximum_filter1d

Array = NDArray[np.float64]

STEP = 1 / 30  # seconds between the positions of which an acceleration is a second difference
SMOOTHING = 0.05  # seconds, standard deviation of the filter on the motion
REACH = 0.1  # seconds before and after a twitch that are smoothed wholly
MAX_ROUNDS = 12
NO_ACCELERATION_LIMIT = 1e6  # m/s², which no joint reaches


def peak_accelerations(motion: Array, fps: float) -> Array:
    """``(J,)`` m/s²: the largest acceleration of each joint.

    Parameters
    ----------
    motion : (T, J, 3) metres
    fps : frames per second
    """
    return np.asarray(_accelerations(motion, fps).max(axis=0, initial=0.0))


def damp_twitches(motion: Array, fps: float, max_accelerations: Array) -> Array:
    """Damp joints that accelerate by more than the limits; a motion within them is unchanged.

    Parameters
    ----------
    motion : (T, J, 3) metres
    fps : frames per second
    max_accelerations : (J,) of ``peak_accelerations``, the largest of captured motion

    Returns
    -------
    (T, J, 3) metres
    """
    reach = 2 * round(REACH * fps) + 1
    for _ in range(MAX_ROUNDS):
        twitches = (_accelerations(motion, fps) > max_accelerations).any(axis=1)
        if not twitches.any():
            break
        near = maximum_filter1d(twitches.astype(np.float64), reach)
        share = gaussian_filter1d(near, REACH / 2 * fps, mode="nearest")[:, None, None]
        smooth = gaussian_filter1d(motion, SMOOTHING * fps, axis=0, mode="nearest")
        motion = motion + share * (smooth - motion)
    return motion


def _accelerations(motion: Array, fps: float) -> Array:
    """``(T, J)`` m/s², zeros where there are no positions before or after."""
    step = max(1, round(STEP * fps))
    found = np.zeros(motion.shape[:2])
    if len(motion) > 2 * step:
        bend = motion[2 * step :] - 2 * motion[step:-step] + motion[: -2 * step]
        found[step:-step] = np.linalg.norm(bend, axis=-1) * (fps / step) ** 2
    return found
