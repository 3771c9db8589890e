"""Balance: a body that stands on both feet is over them.

A generated body drifts while its feet, which slide along slowly, are held: it ends ahead of them or
beside them, and would fall. People who stand still have the pelvis over the line between their
feet. The body above the feet moves back to it, as far as captured bodies are from it.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from pacmo_core.data.segments import feet
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.finish.bones import leg_joints, leg_length
from pacmo_core.finish.stance import Mask

Array = NDArray[np.float64]

# Distance of the pelvis from the line between the ankles, by the legs' length, that captured people
# who stand seldom exceed: 95 % of the frames of the default in which both feet stand.
MAX_LEAN = 0.07
SMOOTHING = 0.2  # seconds, standard deviation of the filter on the way back


def keep_over_feet(
    motion: Array, stands: Mask, lengths: Array, fps: float, skeleton: Skeleton
) -> Array:
    """Move a body above its feet to where both carry it; a body of no two feet is unchanged.

    Parameters
    ----------
    motion : (T, J, 3) metres, y up, with feet where they stand
    stands : (F, T) in which frames each of ``segments.feet`` stands
    lengths : (E,) metres, of the bones
    fps : frames per second
    skeleton : of the motion

    Returns
    -------
    (T, J, 3) metres, of which knees and feet are as they were
    """
    if len(feet(skeleton)) != 2:
        return motion
    first, second = (motion[:, foot[0]] * [1, 0, 1] for foot in feet(skeleton))
    offset = motion[:, skeleton.root] * [1, 0, 1] - first
    line = second - first
    along = (offset * line).sum(axis=1) / np.maximum((line**2).sum(axis=1), 1e-9)
    lean = offset - along.clip(0, 1)[:, None] * line
    distance = np.maximum(np.linalg.norm(lean, axis=1), 1e-9)
    most = MAX_LEAN * leg_length(lengths, skeleton)
    back = np.maximum(1 - most / distance, 0) * stands.all(axis=0)
    way = gaussian_filter1d(back[:, None] * lean, SMOOTHING * fps, axis=0, mode="nearest")
    moved = motion - way[:, None]
    legs = leg_joints(skeleton)
    moved[:, legs] = motion[:, legs]
    return np.asarray(moved)
