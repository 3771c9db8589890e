"""Footsteps: feet in stance are fixed on the ground while the body moves over them."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pacmo_core.synthesis.kinematics import Array, bump, minimum_jerk, window

Path = Callable[[Array], Array]  # (N,) seconds to (N, 3): x, z in metres and yaw in radians

WALK_IN_SECONDS = 1.2  # seconds of walking planned before the first frame
SWING_SHARE = 0.78  # fraction of a step in which its foot is in the air
STEP_CHECK_SECONDS = 0.06  # seconds between decisions whether to step
MAX_FOOT_YAW = 0.75  # radians; largest yaw of a foot relative to the pelvis at landing
PATH_SAMPLE_SECONDS = 0.02  # seconds between samples of a path


@dataclass(frozen=True)
class Gait:
    """The gait of one person in one clip.

    Parameters
    ----------
    step_time : seconds from one footfall to the next
    phase : 0 to 1, the phase of the step at the start
    first : first foot to step, 0 left, 1 right
    stance : half the distance between the feet, metres
    stagger : metres by which the left foot is ahead of the body and the right behind
    toe_out : radians
    lead : metres by which a toe is ahead of the pelvis at rest
    clearance : metres by which a toe is lifted in a long step
    """

    step_time: float
    phase: float
    first: int
    stance: float
    stagger: float
    toe_out: float
    lead: float
    clearance: float


@dataclass(frozen=True)
class Feet:
    """Both feet over time: left, then right.

    Parameters
    ----------
    toes : (2, T, 3) metres; height above the toe in stance
    yaw : (2, T) radians
    heel : (2, T) radians by which the heel is raised about the toe
    air : (2, T) 0 on the ground, 1 in mid-step
    """

    toes: Array
    yaw: Array
    heel: Array
    air: Array


def plan_steps(path: Path, gait: Gait, duration: float) -> list[list[tuple[float, Array]]]:
    """Return each foot's steps: the start time, and the landing position (x, z, yaw).

    A foot steps to where the body will be in the middle of its stance, and only if it is more
    than a few centimetres away from there.
    """
    clock = np.arange(-WALK_IN_SECONDS, duration + 2.5 * gait.step_time + 0.1, PATH_SAMPLE_SECONDS)
    body = path(clock)
    positions = _foot_positions(body, gait)
    ahead = gait.step_time * (0.5 * SWING_SHARE + 1.0)
    plants = [[(-WALK_IN_SECONDS, positions[side, 0])] for side in range(2)]
    now, side = -WALK_IN_SECONDS + gait.phase * gait.step_time, gait.first
    while now < duration:
        goal = positions[side, int((now + ahead + WALK_IN_SECONDS) / PATH_SAMPLE_SECONDS)].copy()
        landing = body[
            int((now + SWING_SHARE * gait.step_time + WALK_IN_SECONDS) / PATH_SAMPLE_SECONDS), 2
        ]
        goal[2] = np.clip(goal[2], landing - MAX_FOOT_YAW, landing + MAX_FOOT_YAW)
        off = goal - plants[side][-1][1]
        if np.hypot(off[0], off[1]) > 0.05 or abs(off[2]) > 0.25:
            plants[side].append((now, goal))
            now += gait.step_time
        else:
            now += STEP_CHECK_SECONDS
        side = 1 - side
    return plants


def _foot_positions(body: Array, gait: Gait) -> Array:
    """Return the stance position of each foot under a body: (2, N, 3) of x, z, yaw."""
    x, z, yaw = body.T
    positions = []
    for sign in (1.0, -1.0):
        left, front = sign * gait.stance, gait.lead + sign * gait.stagger
        positions.append(
            [
                x + left * np.cos(yaw) + front * np.sin(yaw),
                z - left * np.sin(yaw) + front * np.cos(yaw),
                yaw + sign * gait.toe_out,
            ]
        )
    return np.array(positions).transpose(0, 2, 1)


def sample_footsteps(path: Path, gait: Gait, times: Array, duration: float) -> Feet:
    """Return the footsteps of a body that follows ``path``."""
    swing = SWING_SHARE * gait.step_time
    feet = []
    for plants in plan_steps(path, gait, duration):
        position = np.repeat(plants[0][1][None], len(times), axis=0)
        lift, heel, air = np.zeros((3, len(times)))
        for (_, old), (start, new) in pairwise(plants):
            fraction = (times - start) / swing
            length = min(1.0, float(np.hypot(*(new - old)[:2])) / 0.9)
            position = position + minimum_jerk((fraction - 0.06) / 0.88)[:, None] * (new - old)
            air = air + bump(fraction)
            lift = lift + bump(fraction) ** (2 / 3) * gait.clearance * (0.45 + 0.55 * length)
            raised = window(
                times, start - 0.13, start + 0.3 * swing, start + 0.32 * swing, start + swing
            )
            heel = heel + 0.75 * (0.25 + 0.75 * length) * raised
        feet.append((position, lift, heel, air))
    toes = np.array(
        [np.stack([position[:, 0], lift, position[:, 1]], axis=-1) for position, lift, _, _ in feet]
    )
    return Feet(
        toes=toes,
        yaw=np.array([position[:, 2] for position, _, _, _ in feet]),
        heel=np.array([heel for _, _, heel, _ in feet]),
        air=np.array([air for _, _, _, air in feet]),
    )
