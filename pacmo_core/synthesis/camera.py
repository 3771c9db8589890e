"""The depth camera: its place, and the noise with which it sees joints."""

import numpy as np
from scipy.signal import lfilter

from pacmo_core.data.skeleton import NTU25
from pacmo_core.synthesis.curves import Array
from pacmo_core.synthesis.kinematics import pitch, turn

MEMORY = 0.15  # seconds over which the error of a joint is forgotten
FLICKER = 0.15  # share of the error that is new in every frame
DEPTH = 1.4  # error along the camera's axis over that across it
RATE = 30.0

# Metres, standard deviation across the axis: of the size of Kinect v2's (Wang et al. 2015; Otte
# et al. 2016), less in the trunk than in hands and feet.
ERROR = {
    "spine_base": 0.005,
    "spine_mid": 0.004,
    "spine_shoulder": 0.004,
    "neck": 0.005,
    "head": 0.006,
    "shoulder": 0.007,
    "elbow": 0.009,
    "wrist": 0.010,
    "hand": 0.012,
    "hand_tip": 0.017,
    "thumb": 0.017,
    "hip": 0.006,
    "knee": 0.008,
    "ankle": 0.009,
    "foot": 0.012,
}


def place(joints: Array, view: tuple[float, float, float, float, float]) -> Array:
    """Turn the stage into the camera's frame: metres, y up, z away from the camera, right-handed.

    Parameters
    ----------
    joints : (T, J, 3) on the stage of person a
    view : yaw and pitch in radians, height, distance and miss aside in metres
    """
    yaw, tip, height, distance, miss = view
    turned = joints @ turn(np.array([yaw]))[0].T + [miss, -height, distance]
    placed: Array = turned @ pitch(np.array([tip]))[0].T
    return placed


def errors() -> Array:
    """(J,) metres: the standard deviation of each joint of ``NTU25`` across the camera's axis."""
    names = [joint.removeprefix("left_").removeprefix("right_") for joint in NTU25.joints]
    return np.array([ERROR[name] for name in names])


def noise(random: np.random.Generator, frames: int) -> Array:
    """Draw the camera's error of one person: (T, 25, 3) metres.

    A first-order autoregression that starts in its stationary law, and a share of white noise.
    """
    keep = np.exp(-1.0 / (RATE * MEMORY))
    fresh = random.standard_normal((frames, len(NTU25.joints), 3))
    slow = fresh * np.sqrt(1.0 - keep**2)
    slow[0] = fresh[0]
    slow = lfilter([1.0], [1.0, -keep], slow, axis=0)
    white = random.standard_normal(slow.shape)
    error = np.sqrt(1.0 - FLICKER**2) * slow + FLICKER * white
    seen: Array = error * errors()[:, None] * [1.0, 1.0, DEPTH]
    return seen
