"""Bones of exact lengths: of the whole body from the root outwards, and of legs that must reach.

Lengths that are set from the root outwards move the feet off their places. Legs are therefore set
from both ends: the knee lies where a circle about the line from hip to ankle allows (two-bone
inverse kinematics in closed form), on the side to which it bent before.
"""

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.interaction import Motion, bone_lengths
from pacmo_core.data.segments import feet
from pacmo_core.data.skeleton import Skeleton

Array = NDArray[np.float64]

MIN_LENGTH = 1e-9  # metres, below which a bone has no direction
MIN_BEND = 0.08  # metres ahead of the line from hip to ankle, at least, of the direction of a knee
DOWN = np.array([0.0, -1.0, 0.0])


def median_lengths(motion: Motion, skeleton: Skeleton) -> Array:
    """``(E,)`` metres: the median over time of each bone's length."""
    lengths: Array = np.median(bone_lengths(motion, skeleton), axis=0).astype(np.float64)
    return lengths


def set_bone_lengths(motion: Array, lengths: Array, skeleton: Skeleton) -> Array:
    """Set the bones' lengths from the root outwards, in their directions.

    Parameters
    ----------
    motion : (..., J, 3) metres
    lengths : (E,) metres
    skeleton : of the motion
    """
    result = motion.copy()
    length_of = lengths_by_joint(lengths, skeleton)
    for joint in skeleton.order[1:]:
        parent = skeleton.parents[joint]
        bone = resized(motion[..., joint, :] - motion[..., parent, :], np.array(length_of[joint]))
        result[..., joint, :] = result[..., parent, :] + bone
    return result


def set_legs(
    motion: Array,
    wanted: Array,
    floor: Array,
    lengths: Array,
    skeleton: Skeleton,
    slack: float = 0.0,
) -> None:
    """Move knees and feet, in place, so that feet are where they are wanted and not below a floor.

    Parameters
    ----------
    motion : (..., J, 3) metres, with bones of the lengths
    wanted : (..., J, 3) metres, from which the places of ankles and the directions of feet are
    floor : (..., J) metres, height below which a joint must not be; -inf for all but feet
    lengths : (E,) metres
    skeleton : of the motion
    slack : share of a leg's length that it approaches gradually. A knee goes the faster the
        straighter it is, without bound; a leg with slack is never quite straight, and an ankle
        is up to the slack off its place.
    """
    length_of = lengths_by_joint(lengths, skeleton)
    for ankle, *beyond in feet(skeleton):
        knee = skeleton.parents[ankle]
        if skeleton.parents[knee] < 0:
            continue
        target = wanted[..., ankle, :].copy()
        target[..., 1] = np.maximum(target[..., 1], floor[..., ankle])
        _bend(
            motion,
            (skeleton.parents[knee], knee, ankle),
            target,
            _ahead(motion, skeleton),
            length_of,
            slack,
        )
        for joint in beyond:
            parent = skeleton.parents[joint]
            bone = resized(
                wanted[..., joint, :] - wanted[..., parent, :], np.array(length_of[joint])
            )
            lowest = floor[..., joint] - motion[..., parent, 1]
            motion[..., joint, :] = motion[..., parent, :] + raised(bone, lowest)


def _bend(
    motion: Array,
    leg: tuple[int, int, int],
    target: Array,
    ahead: Array,
    length_of: dict[int, float],
    slack: float,
) -> None:
    """Place knee and ankle of a leg; an ankle out of reach is placed in the target's direction.

    The direction in which the knee bends turns with the line from hip to ankle, and is ahead.
    """
    hip, knee, ankle = leg
    upper, lower = length_of[knee], length_of[ankle]
    start = motion[..., hip, :]
    line = target - start
    distance = np.linalg.norm(line, axis=-1, keepdims=True)
    reach = _softened(distance, upper + lower, slack).clip(abs(upper - lower), upper + lower)
    before, along = (resized(x, np.array(1.0)) for x in (motion[..., ankle, :] - start, line))
    bend = _turned(_across(motion[..., knee, :] - start, before), before, along)
    front = _turned(ahead, DOWN, along)
    bend += np.maximum(MIN_BEND - _dot(bend, front), 0) * front
    forward = (upper**2 - lower**2 + reach**2) / (2 * np.maximum(reach, MIN_LENGTH))
    aside = np.sqrt(np.maximum(upper**2 - forward**2, 0))
    motion[..., knee, :] = start + forward * along + aside * resized(bend, np.array(1.0))
    motion[..., ankle, :] = start + reach * along


def _softened(distance: Array, full: float, slack: float) -> Array:
    """Return distances as they are up to the slack; greater ones go to the full one at infinity."""
    if not slack:
        return distance
    free, width = (1 - slack) * full, max(slack * full, MIN_LENGTH)
    beyond = np.maximum(distance - free, 0)
    return np.minimum(distance, free - width * np.expm1(-beyond / width))


def _ahead(motion: Array, skeleton: Skeleton) -> Array:
    """``(..., 3)``: the unit vector in which the body faces, over the ground; z if not known."""
    knees = {skeleton.parents[foot[0]] for foot in feet(skeleton)}
    facing = np.zeros((*motion.shape[:-2], 3))
    for left, right in skeleton.left_right:
        if {left, right} == knees:
            hips = [motion[..., skeleton.parents[knee], :] for knee in (left, right)]
            facing = np.cross(hips[0] - hips[1], [0.0, 1.0, 0.0])
    length = np.linalg.norm(facing, axis=-1, keepdims=True)
    return np.where(length > MIN_LENGTH, facing / np.maximum(length, MIN_LENGTH), [0.0, 0.0, 1.0])


def _turned(vectors: Array, start: Array, end: Array) -> Array:
    """Turn vectors at right angles to a unit vector by the least turn from it to another."""
    share = _dot(vectors, end) / np.maximum(1 + _dot(start, end), MIN_LENGTH)
    return np.asarray(vectors - share * (start + end))


def _dot(first: Array, second: Array) -> Array:
    """Return the inner products of vectors ``(..., 3)``, ``(..., 1)``."""
    return np.asarray((first * second).sum(axis=-1, keepdims=True))


def _across(vectors: Array, along: Array) -> Array:
    """Return the part of vectors ``(..., 3)`` that is at right angles to unit vectors."""
    return np.asarray(vectors - _dot(vectors, along) * along)


def raised(bone: Array, lowest: Array) -> Array:
    """Turn bones ``(..., 3)`` upwards about their start until they rise by ``lowest`` at least."""
    length = np.linalg.norm(bone, axis=-1)
    height = np.maximum(bone[..., 1], np.minimum(lowest, length))
    flat = np.linalg.norm(bone[..., [0, 2]], axis=-1)
    scale = np.sqrt(np.maximum(length**2 - height**2, 0)) / np.maximum(flat, MIN_LENGTH)
    return np.stack([scale * bone[..., 0], height, scale * bone[..., 2]], axis=-1)


def leg_joints(skeleton: Skeleton) -> list[int]:
    """List the joints of the legs below the hips: knee, ankle and those beyond it, foot by foot."""
    return [joint for foot in feet(skeleton) for joint in (skeleton.parents[foot[0]], *foot)]


def leg_length(lengths: Array, skeleton: Skeleton) -> float:
    """Metres from hip to ankle, the mean of the legs; without legs the length of all bones.

    Parameters
    ----------
    lengths : (E,) metres, of the bones
    skeleton : of the bones
    """
    length_of = lengths_by_joint(lengths, skeleton)
    ankles = [foot[0] for foot in feet(skeleton)]
    joints = [joint for ankle in ankles for joint in (ankle, skeleton.parents[ankle])]
    total = sum(length_of.get(joint, 0.0) for joint in joints or length_of)
    return max(total / max(len(ankles), 1), MIN_LENGTH)


def lengths_by_joint(lengths: Array, skeleton: Skeleton) -> dict[int, float]:
    """Return the length of the bone that ends at each joint but the root, metres."""
    return dict(zip(skeleton.bones[:, 1].tolist(), lengths.tolist(), strict=True))


def resized(bones: Array, lengths: Array) -> Array:
    """Give bones ``(..., 3)`` lengths ``(...)``; one of no length points down."""
    norm = np.linalg.norm(bones, axis=-1, keepdims=True)
    direction = np.where(norm > MIN_LENGTH, bones / np.maximum(norm, MIN_LENGTH), [0.0, -1.0, 0.0])
    return direction * lengths[..., None]
