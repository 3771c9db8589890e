"""Sample motions as the depth camera records them: one person, both, or the oracle's reaction.

With S the script and V_x person x's private variables, x's motion is f_x(S, V_x): given S the two
are independent. To keep S and one person's motion, and sample the other's private variables and
camera noise anew, is therefore to sample exactly from the distribution of the reaction given S and
the partner.
"""

from dataclasses import replace

import numpy as np
from scipy.signal import lfilter

from pacmo_core.data.interaction import Interaction, Motion
from pacmo_core.data.skeleton import NTU25
from pacmo_core.synthesis import embraces, meetings, strikes
from pacmo_core.synthesis.body import sample_private_variables
from pacmo_core.synthesis.choreography import RoleView
from pacmo_core.synthesis.gait import sample_footsteps
from pacmo_core.synthesis.kinematics import Array, rotation_x, rotation_y, sum_of_sines
from pacmo_core.synthesis.pose import pose_body
from pacmo_core.synthesis.script import FPS, Role, Script

NOISE_CORRELATION_SECONDS = 0.15  # correlation time of a joint's error, seconds
WHITE_NOISE_SHARE = 0.15  # fraction of the error that is white noise
DEPTH_NOISE_RATIO = 1.4  # ratio of the error along the camera's axis to that across it
CAMERA_FPS = 30.0

# Metres, standard deviation across the axis: of the size of Kinect v2's (Wang et al. 2015; Otte
# et al. 2016), less in the trunk than in hands and feet.
NOISE_SCALE = {
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


def to_camera_frame(joints: Array, view: tuple[float, float, float, float, float]) -> Array:
    """Transform to the camera's frame: metres, y up, z away from the camera, right-handed.

    Parameters
    ----------
    joints : (T, J, 3) in person a's frame
    view : yaw and pitch in radians, height, distance and lateral offset in metres
    """
    yaw, tilt, height, distance, lateral = view
    rotated = joints @ rotation_y(np.array([yaw]))[0].T + [lateral, -height, distance]
    placed: Array = rotated @ rotation_x(np.array([tilt]))[0].T
    return placed


def joint_noise_scale() -> Array:
    """(J,) metres: the standard deviation of each joint of ``NTU25`` across the camera's axis."""
    names = [joint.removeprefix("left_").removeprefix("right_") for joint in NTU25.joints]
    return np.array([NOISE_SCALE[name] for name in names])


def sample_noise(random: np.random.Generator, frames: int) -> Array:
    """Sample the camera's error of one person: (T, 25, 3) metres.

    First-order autoregression that starts in its stationary distribution, plus white noise.
    """
    decay = np.exp(-1.0 / (CAMERA_FPS * NOISE_CORRELATION_SECONDS))
    fresh = random.standard_normal((frames, len(NTU25.joints), 3))
    slow = fresh * np.sqrt(1.0 - decay**2)
    slow[0] = fresh[0]
    slow = lfilter([1.0], [1.0, -decay], slow, axis=0)
    white = random.standard_normal(slow.shape)
    error = np.sqrt(1.0 - WHITE_NOISE_SHARE**2) * slow + WHITE_NOISE_SHARE * white
    scaled: Array = error * joint_noise_scale()[:, None] * [1.0, 1.0, DEPTH_NOISE_RATIO]
    return scaled


PLANS = {
    "approach": meetings.approach,
    "depart": meetings.depart,
    "point": meetings.point,
    "handshake": meetings.handshake,
    "high five": meetings.high_five,
    "push": strikes.push,
    "kick": strikes.kick,
    "punch": strikes.punch,
    "hug": embraces.hug,
    "hand over": meetings.hand_over,
    "circle dance": embraces.circle_dance,
}


def noiseless_motion(script: Script, random: np.random.Generator, role: Role) -> Array:
    """Compute one person's motion without camera noise: (T, 25, 3) float64, metres.

    In person a's frame: y up, the meeting plane at z = 0, person b at positive z.
    """
    people = script.people
    index = "ab".index(role)
    subject, other = people[index], people[1 - index]
    private = sample_private_variables(random, subject)
    plan = PLANS[script.action](RoleView(script, role, subject, other, private))
    gait = replace(private.gait, step_time=private.gait.step_time / plan.step_rate_factor)
    times = np.array(script.frame_times)
    feet = sample_footsteps(plan.path, gait, times, script.duration)
    joints = pose_body(
        subject, plan, feet, times, sum_of_sines(times, private.phases, private.rates)
    )
    # 180 degrees about y bring person b from b's own frame to person a's.
    return joints if role == "a" else joints * [-1.0, 1.0, -1.0]


def sample_motion(script: Script, random: np.random.Generator, role: Role) -> Motion:
    """Sample one person's private variables and the motion as the camera records it.

    Returns
    -------
    (T, 25, 3) float32, metres, in the camera's frame
    """
    joints = to_camera_frame(noiseless_motion(script, random, role), script.view)
    return (joints + sample_noise(random, len(joints))).astype(np.float32)


def sample_interaction(script: Script, random: np.random.Generator) -> Interaction:
    """Sample both people, each with its own generator spawned from ``random``: a's, then b's.

    The times are nominal: as in an NTU file, a capture does not contain its frames' true times.
    """
    for_a, for_b = random.spawn(2)
    return Interaction(
        skeleton=NTU25,
        times=np.arange(len(script.frame_times)) / FPS,
        person_a=sample_motion(script, for_a, "a"),
        person_b=sample_motion(script, for_b, "b"),
    )


def sample_oracle_reaction(script: Script, role: Role, random: np.random.Generator) -> Motion:
    """Sample ``role``'s reaction again for the same partner's motion (the oracle).

    The pair (partner, this sample) has the same distribution as (partner, real reaction).

    Returns
    -------
    (T, 25, 3) float32, metres, in the camera's frame
    """
    return sample_motion(script, random, role)
