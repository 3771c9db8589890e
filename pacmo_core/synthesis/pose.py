"""From a part to 25 joints: the trunk first, then legs to the feet and arms to their reaches."""

import numpy as np

from pacmo_core.data.skeleton import NTU25
from pacmo_core.synthesis.body import Subject
from pacmo_core.synthesis.curves import Array, bump, minimum_jerk
from pacmo_core.synthesis.gait import Feet
from pacmo_core.synthesis.kinematics import pitch, roll, two_bones, unit
from pacmo_core.synthesis.part import Part, Reach
from pacmo_core.synthesis.trunk import Trunk, ankles, spell, stand

SIDES = (("left", 1.0), ("right", -1.0))
HANG = 0.972  # of a straight arm: how a relaxed arm hangs
ARM_SWING = 0.62  # radians a metre of stride


def embody(person: Subject, part: Part, feet: Feet, times: Array, sway: Array) -> Array:
    """Give every joint its place.

    Parameters
    ----------
    feet : where the feet are without the kick
    times : (T,) seconds
    sway : (11, T): seven rows for the trunk, two for each arm

    Returns
    -------
    (T, 25, 3) float64, metres, in the person's own frame on the stage
    """
    trunk = stand(person, part, feet, times, sway[:7])
    joints = dict(trunk.joints)
    for side, (name, sign) in enumerate(SIDES):
        joints |= _leg(person, part, trunk, feet, (side, name, sign), times)
        stride = _ahead(feet, trunk, side)
        rest = _rest(person, trunk, (name, sign), sway[7 + 2 * side :][:2], stride)
        joints |= _arm(person, part, trunk, (side, name, sign), times, rest)
    return np.stack([joints[name] for name in NTU25.joints], axis=1)


def _leg(
    person: Subject,
    part: Part,
    trunk: Trunk,
    feet: Feet,
    limb: tuple[int, str, float],
    times: Array,
) -> dict[str, Array]:
    body, (side, name, sign) = person.body, limb
    ankle, flex = ankles(person, feet, side), feet.heel[side]
    forward = unit(trunk.pelvis[:, :, 2] + np.stack(_heading(feet.yaw[side]), axis=-1))
    if part.kick is not None and part.kick.foot == side:
        chamber, thrust = spell(times, part.kick.chamber), spell(times, part.kick.thrust)
        hip = trunk.joints[f"{name}_hip"]
        tucked = hip + trunk.pelvis @ [0.0, -0.52 * body.leg, 0.22 * body.leg]
        ankle = ankle + chamber[:, None] * (tucked - ankle)
        ankle = ankle + thrust[:, None] * (np.array(part.kick.point) - ankle)
        flex = flex + 0.5 * chamber * (1.0 - thrust) - 0.7 * thrust
    # Ahead and up: a knee bends forward under the body and upward in a kick.
    pole = forward + 0.12 * sign * trunk.pelvis[:, :, 0] + [0.0, 0.8, 0.0]
    knee, ankle = two_bones(trunk.joints[f"{name}_hip"], ankle, (body.thigh, body.shank), pole)
    toe = np.array([0.0, body.foot_height - body.ankle_height, body.foot_forward])
    heading = _frame(feet.yaw[side]) @ pitch(flex)
    return {f"{name}_knee": knee, f"{name}_ankle": ankle, f"{name}_foot": ankle + heading @ toe}


def _heading(yaw: Array) -> tuple[Array, Array, Array]:
    return np.sin(yaw), np.zeros_like(yaw), np.cos(yaw)


def _frame(yaw: Array) -> Array:
    ahead = np.stack(_heading(yaw), axis=-1)
    up = np.tile([0.0, 1.0, 0.0], (len(yaw), 1))
    return np.stack([np.cross(up, ahead), up, ahead], axis=-1)


def _ahead(feet: Feet, trunk: Trunk, side: int) -> Array:
    """How far the other foot is ahead of this side's, metres: an arm swings with the other leg."""
    apart = feet.toes[1 - side] - feet.toes[side]
    ahead: Array = (apart * trunk.pelvis[:, :, 2]).sum(axis=-1)
    return ahead


def _rest(
    person: Subject,
    trunk: Trunk,
    limb: tuple[str, float],
    sway: Array,
    stride: Array,
) -> Array:
    """Let an arm hang, swinging: (T, 3) where its palm would be."""
    body, (name, sign) = person.body, limb
    angle = 0.10 + 0.05 * sway[0] + ARM_SWING * person.swing * stride
    spread = 0.13 + 0.03 * sway[1]
    down = trunk.upright @ pitch(-angle) @ roll(sign * spread)
    bent = HANG - 0.05 * minimum_jerk(np.abs(stride) / 0.6)
    rest: Array = trunk.joints[f"{name}_shoulder"] - (body.arm * bent)[:, None] * down[:, :, 1]
    return rest


def _arm(
    person: Subject,
    part: Part,
    trunk: Trunk,
    limb: tuple[int, str, float],
    times: Array,
    palm: Array,
) -> dict[str, Array]:
    body, (side, name, sign) = person.body, limb
    flare = np.full_like(times, 0.15)
    for reach in part.reaches:
        if reach.hand == side:
            weight = spell(times, reach.spell)
            palm = palm + weight[:, None] * (_goal(reach, trunk, times) - palm)
            palm = palm + _detour(reach, times, trunk.upright)
            flare = flare + weight * (reach.flare - flare)
    out, back = sign * trunk.chest[:, :, 0], -trunk.chest[:, :, 2]
    down = -trunk.chest[:, :, 1]
    pole = (0.25 + flare)[:, None] * out + (1.0 - 0.75 * flare)[:, None] * (0.8 * back + 0.6 * down)
    shoulder = trunk.joints[f"{name}_shoulder"]
    elbow, palm = two_bones(shoulder, palm, (body.upper_arm, body.forearm + body.palm), pole)
    along = (palm - elbow) / (body.forearm + body.palm)
    inward = unit(np.cross(along, np.cross(-out, along)))
    return {
        f"{name}_elbow": elbow,
        f"{name}_wrist": elbow + body.forearm * along,
        f"{name}_hand": palm,
        f"{name}_hand_tip": palm + body.finger * unit(along + 0.25 * inward),
        f"{name}_thumb": palm + body.thumb * unit(0.6 * along + inward),
    }


def _goal(reach: Reach, trunk: Trunk, times: Array) -> Array:
    course = reach.course(times)
    if not reach.on_chest:
        return course
    placed: Array = trunk.joints["spine_shoulder"] + (trunk.chest @ course[..., None])[..., 0]
    return placed


def _detour(reach: Reach, times: Array, upright: Array) -> Array:
    """Bend the way to a reach and back again, most at half way."""
    when = reach.spell
    way = bump((times - when.start) / (when.arrive - when.start))
    way = way + bump((times - when.leave) / (when.back - when.leave))
    bend: Array = way[:, None] * (upright @ np.array(reach.detour))
    return bend
