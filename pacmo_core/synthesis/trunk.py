"""Pelvis, spine and head from a path, leans and sway."""

from dataclasses import dataclass

import numpy as np

from pacmo_core.synthesis.body import Subject
from pacmo_core.synthesis.curves import Array, soft_min, window
from pacmo_core.synthesis.gait import Feet
from pacmo_core.synthesis.kinematics import pitch, roll, turn
from pacmo_core.synthesis.part import Lean, Part, Spell

STRAIGHT = 0.990  # of a leg: what standing and walking stretch it to
SHIFT = 0.022  # metres that the pelvis goes over the standing leg in a step
SWAY = np.array([0.006, 0.006, 0.012, 0.010, 0.020, 0.030, 0.045])  # metres, metres, radians


@dataclass(frozen=True)
class Trunk:
    """Places (T, 3) and frames (T, 3, 3) of the trunk over time.

    Parameters
    ----------
    joints : by name of ``NTU25``: the spine, neck, head, hips and shoulders
    pelvis, chest : rotations from the body's frame to the stage
    upright : the chest's rotation about y alone
    """

    joints: dict[str, Array]
    pelvis: Array
    chest: Array
    upright: Array


def spell(times: Array, when: Spell) -> Array:
    """Say how much of a spell is on at each time."""
    return window(times, when.start, when.arrive, when.leave, when.back)


def gather(leans: tuple[Lean, ...], times: Array) -> dict[str, Array]:
    """Add up leans: (T,) for each of a lean's quantities."""
    names = ("pitch", "roll", "twist", "nod", "crouch", "aside", "ahead")
    total = {name: np.zeros_like(times) for name in names}
    for lean in leans:
        weight = spell(times, lean.spell)
        total = {name: total[name] + weight * getattr(lean, name) for name in names}
    return total


def stand(person: Subject, part: Part, feet: Feet, times: Array, sway: Array) -> Trunk:
    """Raise a trunk over its feet.

    Parameters
    ----------
    sway : (7, T) of variance 1: pelvis ahead and aside; pitch, roll, twist; the head's nod and turn
    """
    lean = gather(part.leans, times)
    x, z, yaw = part.path(times).T
    ahead, aside, tip, tilt, twist, nod, shake = SWAY[:, None] * sway
    ahead = ahead + lean["ahead"]
    aside = aside + lean["aside"] + SHIFT * (feet.air[1] - feet.air[0])
    stride = _stride(feet, yaw)
    hips = turn(yaw - 0.25 * stride)
    chest_yaw = yaw + twist + lean["twist"] + 0.25 * stride
    bow = person.stoop + tip + lean["pitch"]
    lower = turn(0.6 * yaw + 0.4 * chest_yaw) @ pitch(0.6 * bow) @ roll(0.5 * (tilt + lean["roll"]))
    chest = turn(chest_yaw) @ pitch(bow) @ roll(tilt + lean["roll"])
    head = (
        turn(yaw + 0.5 * (chest_yaw - yaw) + shake)
        @ pitch(0.45 * bow + nod + lean["nod"] + 0.06)
        @ roll(0.5 * lean["roll"])
    )
    base = np.stack([x, np.zeros_like(x), z], axis=-1)
    base = base + turn(yaw)[:, :, 0] * aside[:, None] + turn(yaw)[:, :, 2] * ahead[:, None]
    base[:, 1] = height(person, feet, base, hips) - lean["crouch"]
    return Trunk(_spine(person, base, hips, lower, chest, head), hips, chest, turn(chest_yaw))


def _stride(feet: Feet, yaw: Array) -> Array:
    """How far the left foot is ahead of the right, metres."""
    apart = feet.toes[0] - feet.toes[1]
    stride: Array = apart[:, 0] * np.sin(yaw) + apart[:, 2] * np.cos(yaw)
    return stride


def height(person: Subject, feet: Feet, base: Array, hips: Array) -> Array:
    """Let the pelvis ride as high as both legs allow, and no higher than upright."""
    body = person.body
    high = np.full(len(base), STRAIGHT * body.leg + body.ankle_height)
    for side, sign in ((0, 1.0), (1, -1.0)):
        ankle = ankles(person, feet, side)
        hip = base + sign * body.hip_half * hips[:, :, 0]
        apart = np.hypot(ankle[:, 0] - hip[:, 0], ankle[:, 2] - hip[:, 2])
        rise = np.sqrt(np.maximum((STRAIGHT * body.leg) ** 2 - apart**2, 0.01))
        high = soft_min(high, rise + ankle[:, 1], 0.006)
    raised: Array = high + body.hip_drop
    return raised


def ankles(person: Subject, feet: Feet, side: int) -> Array:
    """Where the ankle of a foot is, given its toe, its turn and its raised heel: (T, 3)."""
    body = person.body
    back = np.array([0.0, body.ankle_height - body.foot_height, -body.foot_forward])
    toe = feet.toes[side] + [0.0, body.foot_height, 0.0]
    placed: Array = toe + (turn(feet.yaw[side]) @ pitch(feet.heel[side])) @ back
    return placed


def _spine(
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
    """Tilt of the head: its joint sits above and a little ahead of the neck."""
    up = np.array([0.0, 0.985, 0.1726])
    tilted: Array = head @ (up / np.linalg.norm(up))
    return tilted
