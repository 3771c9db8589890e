"""Joint positions from a motion plan: first the trunk, then the limbs by two-bone IK."""

from dataclasses import dataclass

import numpy as np

from pacmo_core.data.skeleton import NTU25
from pacmo_core.synthesis.body import Subject
from pacmo_core.synthesis.choreography import HandTarget, MotionPlan, TimeInterval, TrunkMotion
from pacmo_core.synthesis.gait import Feet
from pacmo_core.synthesis.kinematics import (
    Array,
    bump,
    minimum_jerk,
    normalise,
    rotation_x,
    rotation_y,
    rotation_z,
    soft_min,
    two_bone_ik,
    window,
)

# Of the leg's length, the largest extension in standing and walking, and of any leg; and metres
# over which the first is smoothed. Knees of people who stand bend by 11 to 13 degrees.
MAX_LEG_EXTENSION, LEG_LIMIT, LEG_LIMIT_WIDTH = 0.997, 0.9995, 0.002
PELVIS_SHIFT = 0.022  # metres by which the pelvis shifts over the stance leg in a step
SWAY_SCALE = np.array([0.006, 0.006, 0.012, 0.010, 0.020, 0.030, 0.045])  # metres, metres, radians


@dataclass(frozen=True)
class Trunk:
    """Positions (T, 3) and rotations (T, 3, 3) of the trunk over time.

    Parameters
    ----------
    joints : by name of ``NTU25``: the spine, neck, head, hips and shoulders
    pelvis, chest : rotations from the body's frame to the person's frame
    upright : the chest's rotation about y alone
    """

    joints: dict[str, Array]
    pelvis: Array
    chest: Array
    upright: Array


def window_weight(times: Array, interval: TimeInterval) -> Array:
    """Return the weight of an interval at each time."""
    return window(times, interval.start, interval.arrive, interval.leave, interval.back)


def sum_trunk_motions(trunk_motions: tuple[TrunkMotion, ...], times: Array) -> dict[str, Array]:
    """Return the sum of trunk motions: (T,) for each of their quantities."""
    names = ("pitch", "roll", "twist", "nod", "crouch", "aside", "ahead")
    total = {name: np.zeros_like(times) for name in names}
    for trunk_motion in trunk_motions:
        weight = window_weight(times, trunk_motion.interval)
        total = {name: total[name] + weight * getattr(trunk_motion, name) for name in names}
    return total


def pose_trunk(person: Subject, plan: MotionPlan, feet: Feet, times: Array, sway: Array) -> Trunk:
    """Pose the trunk over the feet.

    Parameters
    ----------
    sway : (7, T) of variance 1: pelvis ahead and aside; pitch, roll, twist; the head's nod and turn
    """
    trunk_motion = sum_trunk_motions(plan.trunk_motions, times)
    x, z, yaw = plan.path(times).T
    ahead, aside, tip, tilt, twist, nod, shake = SWAY_SCALE[:, None] * sway
    ahead = ahead + trunk_motion["ahead"]
    aside = aside + trunk_motion["aside"] + PELVIS_SHIFT * (feet.air[1] - feet.air[0])
    stride = _stride(feet, yaw)
    hips = rotation_y(yaw - 0.25 * stride)
    chest_yaw = yaw + twist + trunk_motion["twist"] + 0.25 * stride
    bend = person.stoop + tip + trunk_motion["pitch"]
    lower = (
        rotation_y(0.6 * yaw + 0.4 * chest_yaw)
        @ rotation_x(0.6 * bend)
        @ rotation_z(0.5 * (tilt + trunk_motion["roll"]))
    )
    chest = rotation_y(chest_yaw) @ rotation_x(bend) @ rotation_z(tilt + trunk_motion["roll"])
    head = (
        rotation_y(yaw + 0.5 * (chest_yaw - yaw) + shake)
        @ rotation_x(0.45 * bend + nod + trunk_motion["nod"] + 0.06)
        @ rotation_z(0.5 * trunk_motion["roll"])
    )
    base = np.stack([x, np.zeros_like(x), z], axis=-1)
    base = (
        base + rotation_y(yaw)[:, :, 0] * aside[:, None] + rotation_y(yaw)[:, :, 2] * ahead[:, None]
    )
    base[:, 1] = pelvis_height(person, feet, base, hips) - trunk_motion["crouch"]
    return Trunk(
        _trunk_joints(person, base, hips, lower, chest, head), hips, chest, rotation_y(chest_yaw)
    )


def _stride(feet: Feet, yaw: Array) -> Array:
    """Return the metres by which the left foot is ahead of the right."""
    offset = feet.toes[0] - feet.toes[1]
    stride: Array = offset[:, 0] * np.sin(yaw) + offset[:, 2] * np.cos(yaw)
    return stride


def pelvis_height(person: Subject, feet: Feet, base: Array, hips: Array) -> Array:
    """Return the height of the pelvis: as high as both legs allow, at most upright."""
    body = person.body
    high = np.full(len(base), MAX_LEG_EXTENSION * body.leg + body.ankle_height)
    for side, sign in ((0, 1.0), (1, -1.0)):
        ankle = ankle_positions(person, feet, side)
        hip = base + sign * body.hip_half * hips[:, :, 0]
        offset = np.hypot(ankle[:, 0] - hip[:, 0], ankle[:, 2] - hip[:, 2])
        rise = np.sqrt(np.maximum((MAX_LEG_EXTENSION * body.leg) ** 2 - offset**2, 0.01))
        high = soft_min(high, rise + ankle[:, 1], LEG_LIMIT_WIDTH)
    raised: Array = high + body.hip_drop
    return raised


def ankle_positions(person: Subject, feet: Feet, side: int) -> Array:
    """Return ankle positions from toe, yaw and heel pitch: (T, 3)."""
    body = person.body
    back = np.array([0.0, body.ankle_height - body.foot_height, -body.foot_forward])
    toe = feet.toes[side] + [0.0, body.foot_height, 0.0]
    placed: Array = toe + (rotation_y(feet.yaw[side]) @ rotation_x(feet.heel[side])) @ back
    return placed


def _trunk_joints(
    person: Subject, base: Array, hips: Array, lower: Array, chest: Array, head: Array
) -> dict[str, Array]:
    body = person.body
    middle = base + body.lower_spine * lower[:, :, 1]
    top = middle + body.upper_spine * chest[:, :, 1]
    neck = top + body.neck * chest[:, :, 1]
    joints = {
        "spine_base": base,
        "spine_mid": middle,
        "spine_shoulder": top,
        "neck": neck,
        "head": neck + body.head * _head_up(head),
    }
    for name, sign in (("left", 1.0), ("right", -1.0)):
        hip = np.array([sign * body.hip_half, -body.hip_drop, 0.0])
        shoulder = np.array([sign * body.shoulder_half, -body.shoulder_drop, 0.0])
        joints[f"{name}_hip"] = base + hips @ hip
        joints[f"{name}_shoulder"] = top + chest @ shoulder
    return joints


def _head_up(head: Array) -> Array:
    """Return the direction from the neck to the head: upwards and a little forward."""
    up = np.array([0.0, 0.985, 0.1726])
    tilted: Array = head @ (up / np.linalg.norm(up))
    return tilted


SIDES = (("left", 1.0), ("right", -1.0))
RELAXED_ARM_EXTENSION = 0.972  # of arm length: extension of a relaxed arm
ARM_SWING = 0.62  # radians per metre of stride


def pose_body(person: Subject, plan: MotionPlan, feet: Feet, times: Array, sway: Array) -> Array:
    """Compute the positions of all 25 joints.

    Parameters
    ----------
    feet : the footsteps, without the kick
    times : (T,) seconds
    sway : (11, T): seven rows for the trunk, two for each arm

    Returns
    -------
    (T, 25, 3) float64, metres, in the person's own frame
    """
    trunk = pose_trunk(person, plan, feet, times, sway[:7])
    joints = dict(trunk.joints)
    for side, (name, sign) in enumerate(SIDES):
        joints |= _leg(person, plan, trunk, feet, (side, name, sign), times)
        stride = _stride_of_other_leg(feet, trunk, side)
        rest = _relaxed_hand(person, trunk, (name, sign), sway[7 + 2 * side :][:2], stride)
        joints |= _arm(person, plan, trunk, (side, name, sign), times, rest)
    return np.stack([joints[name] for name in NTU25.joints], axis=1)


def _leg(
    person: Subject,
    plan: MotionPlan,
    trunk: Trunk,
    feet: Feet,
    limb: tuple[int, str, float],
    times: Array,
) -> dict[str, Array]:
    body, (side, name, sign) = person.body, limb
    hip, ankle = trunk.joints[f"{name}_hip"], ankle_positions(person, feet, side)
    flex = feet.heel[side]
    forward = normalise(trunk.pelvis[:, :, 2] + np.stack(_heading(feet.yaw[side]), axis=-1))
    if plan.kick is not None and plan.kick.foot == side:
        chamber, thrust = (
            window_weight(times, plan.kick.chamber),
            window_weight(times, plan.kick.thrust),
        )
        tucked = hip + trunk.pelvis @ [0.0, -0.52 * body.leg, 0.22 * body.leg]
        ankle = ankle + chamber[:, None] * (tucked - ankle)
        ankle = ankle + thrust[:, None] * (np.array(plan.kick.point) - ankle)
        flex = flex + 0.5 * chamber * (1.0 - thrust) - 0.7 * thrust
    # Forward and up: a knee bends forward under the body and upward in a kick.
    pole = forward + 0.12 * sign * trunk.pelvis[:, :, 0] + [0.0, 0.8, 0.0]
    knee, ankle = two_bone_ik(hip, ankle, (body.thigh, body.shank), pole, LEG_LIMIT)
    toe = np.array([0.0, body.foot_height - body.ankle_height, body.foot_forward])
    heading = _frame(feet.yaw[side]) @ rotation_x(flex)
    return {f"{name}_knee": knee, f"{name}_ankle": ankle, f"{name}_foot": ankle + heading @ toe}


def _heading(yaw: Array) -> tuple[Array, Array, Array]:
    return np.sin(yaw), np.zeros_like(yaw), np.cos(yaw)


def _frame(yaw: Array) -> Array:
    ahead = np.stack(_heading(yaw), axis=-1)
    up = np.tile([0.0, 1.0, 0.0], (len(yaw), 1))
    return np.stack([np.cross(up, ahead), up, ahead], axis=-1)


def _stride_of_other_leg(feet: Feet, trunk: Trunk, side: int) -> Array:
    """Return the metres by which the other foot is ahead: an arm swings with the opposite leg."""
    offset = feet.toes[1 - side] - feet.toes[side]
    ahead: Array = (offset * trunk.pelvis[:, :, 2]).sum(axis=-1)
    return ahead


def _relaxed_hand(
    person: Subject,
    trunk: Trunk,
    limb: tuple[str, float],
    sway: Array,
    stride: Array,
) -> Array:
    """Return palm positions of a hanging, swinging arm: (T, 3)."""
    body, (name, sign) = person.body, limb
    angle = 0.10 + 0.05 * sway[0] + ARM_SWING * person.swing * stride
    spread = 0.13 + 0.03 * sway[1]
    down = trunk.upright @ rotation_x(-angle) @ rotation_z(sign * spread)
    bent = RELAXED_ARM_EXTENSION - 0.05 * minimum_jerk(np.abs(stride) / 0.6)
    rest: Array = trunk.joints[f"{name}_shoulder"] - (body.arm * bent)[:, None] * down[:, :, 1]
    return rest


def _arm(
    person: Subject,
    plan: MotionPlan,
    trunk: Trunk,
    limb: tuple[int, str, float],
    times: Array,
    palm: Array,
) -> dict[str, Array]:
    body, (side, name, sign) = person.body, limb
    flare = np.full_like(times, 0.15)
    for reach in plan.hand_targets:
        if reach.hand == side:
            weight = window_weight(times, reach.interval)
            palm = palm + weight[:, None] * (_target_position(reach, trunk, times) - palm)
            palm = palm + _curved_offset(reach, times, trunk.upright)
            flare = flare + weight * (reach.flare - flare)
    out, back = sign * trunk.chest[:, :, 0], -trunk.chest[:, :, 2]
    down = -trunk.chest[:, :, 1]
    pole = (0.25 + flare)[:, None] * out + (1.0 - 0.75 * flare)[:, None] * (0.8 * back + 0.6 * down)
    shoulder = trunk.joints[f"{name}_shoulder"]
    elbow, palm = two_bone_ik(shoulder, palm, (body.upper_arm, body.forearm + body.palm), pole)
    along = (palm - elbow) / (body.forearm + body.palm)
    inward = normalise(np.cross(along, np.cross(-out, along)))
    return {
        f"{name}_elbow": elbow,
        f"{name}_wrist": elbow + body.forearm * along,
        f"{name}_hand": palm,
        f"{name}_hand_tip": palm + body.finger * normalise(along + 0.25 * inward),
        f"{name}_thumb": palm + body.thumb * normalise(0.6 * along + inward),
    }


def _target_position(reach: HandTarget, trunk: Trunk, times: Array) -> Array:
    trajectory = reach.trajectory(times)
    if not reach.relative_to_chest:
        return trajectory
    placed: Array = trunk.joints["spine_shoulder"] + (trunk.chest @ trajectory[..., None])[..., 0]
    return placed


def _curved_offset(reach: HandTarget, times: Array, upright: Array) -> Array:
    """Return the offset that curves the path to a target and back, largest half way."""
    when = reach.interval
    distance = bump((times - when.start) / (when.arrive - when.start))
    distance = distance + bump((times - when.leave) / (when.back - when.leave))
    bend: Array = distance[:, None] * (upright @ np.array(reach.curve))
    return bend
