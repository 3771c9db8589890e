"""The fastest moments of a motion: turns of bones and accelerations of joints, and where they are.

Means and percentiles over time hide a jump in one frame, which everybody sees: bones and joints
are named with frame and time.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.interaction import Motion
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.formats.resample import frame_rate

# Metres per second squared, of a joint: 99 of 100 captured motions of the default stay below.
MAX_ACCELERATION = 150.0
ACCELERATION_STEP = 1 / 30  # seconds between the positions of which it is measured
# Degrees a second that a bone turns between two frames: 25 degrees at 30 frames a second. In 99.9 %
# of 30,000 recorded frames (salsa, acts, embraces, walking) none turns by more than 22.8 degrees,
# and by 24.2 at most in 46 of the 48 files; in the other two single markers flicker.
MAX_TURN_SPEED = 750.0
# Metres: a shorter bone, of which these turns move the end by 2 mm, has no turn. The last bones of
# a child's fingers are 14 mm long, and their tips are seen to jump.
MIN_BONE = 0.005

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Peak:
    """Where a measured value is greatest.

    Parameters
    ----------
    row, column : in the measured array
    joint : that accelerates, or at the end of the bone that turns
    frame : from 0; of a turn the second of the two frames
    time : seconds after the first frame
    """

    row: int
    column: int
    joint: str
    frame: int
    time: float

    @property
    def place(self) -> str:
        """Frame and time, in words."""
        return when(self.frame, self.time)


def when(frame: int, seconds: float) -> str:
    """Return a frame, counted from 0, and its time in words."""
    return f"in frame {frame} ({seconds:.2f} s)"


def find_peak(values: Array, joints: tuple[str, ...], times: Array) -> Peak:
    """Find the greatest of depths, ``bone_turns``, ``joint_accelerations`` or ratios of these.

    Parameters
    ----------
    values : (T, J), (T - 1, E) or (T - 2 k, J)
    joints : the name of each column
    times : (T,) seconds
    """
    row, column = (int(i) for i in np.unravel_index(values.argmax(), values.shape))
    # Turns are of the second of two frames, accelerations of the middle one of three.
    frame = row + (len(times) - len(values) + 1) // 2
    return Peak(row, column, joints[column], frame, float(times[frame] - times[0]))


def angles(first: Array, second: Array) -> Array:
    """Return the angles in degrees between vectors ``(..., 3)``."""
    sine = np.linalg.norm(np.cross(first, second), axis=-1)
    degrees: Array = np.degrees(np.arctan2(sine, (first * second).sum(axis=-1)))
    return degrees


def bone_turns(skeleton: Skeleton, motion: Motion) -> Array:
    """Return the turn of each bone from a frame to the next, ``(T - 1, E)`` degrees.

    Bones that are shorter than ``MIN_BONE`` have no turn.
    """
    ends = motion[:, skeleton.bones].astype(np.float64)
    bones = ends[:, :, 1] - ends[:, :, 0]
    turns = angles(bones[:-1], bones[1:])
    is_long = np.linalg.norm(bones, axis=-1).min(axis=0) >= MIN_BONE
    return np.where(is_long, turns, 0.0)


def max_turn(times: Array) -> float:
    """Return the largest turn from a frame to the next that people make, in degrees."""
    return min(MAX_TURN_SPEED / frame_rate(times), 180.0)


def bone_names(skeleton: Skeleton) -> tuple[str, ...]:
    """Return the joint at the end of each bone."""
    return tuple(skeleton.joints[child] for child in skeleton.bones[:, 1].tolist())


def joint_accelerations(times: Array, motion: Motion) -> Array:
    """Return the acceleration of each joint, ``(T - 2 k, J)`` m/s², from frames k apart.

    These are 1/30 s apart, or neighbours at lower frame rates: between the frames of 120 a second
    the same motion would accelerate several times as much, by the noise of capture and fit.
    """
    lag = min(max(1, round(frame_rate(times) * ACCELERATION_STEP)), max(1, (len(times) - 1) // 2))
    steps = (times[lag:] - times[:-lag])[:, None, None]
    positions = motion.astype(np.float64)
    velocity = (positions[lag:] - positions[:-lag]) / steps
    change = (velocity[lag:] - velocity[:-lag]) / ((steps[lag:] + steps[:-lag]) / 2)
    accelerations: Array = np.linalg.norm(change, axis=-1)
    return accelerations
