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
MIN_BEND = 1e-4  # metres from the line from hip to ankle, within which a knee is straight


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


def with_lengths(motion: Array, lengths: Array, ground: Array, skeleton: Skeleton) -> Array:
    """Give a body other bones where it stands.

    Heights over the ground are in proportion to the legs, directions of bones stay, and so do the
    places of the feet over the ground, from which the legs are set.

    Parameters
    ----------
    motion : (T, J, 3) metres, y up
    lengths : (E,) metres
    ground : (T,) metres, height of the ground beneath the body
    skeleton : of the motion
    """
    own = lengths_by_joint(median_lengths(motion.astype(np.float32), skeleton), skeleton)
    wanted = lengths_by_joint(lengths, skeleton)
    shins = [foot[0] for foot in feet(skeleton)]
    legs = [joint for ankle in shins for joint in (ankle, skeleton.parents[ankle]) if joint in own]
    ratio = sum(wanted[j] for j in legs or own) / sum(own[j] for j in legs or own)
    nearer = motion.copy()
    nearer[..., 1] = ground[:, None] + ratio * (motion[..., 1] - ground[:, None])
    moved = motion + (nearer - motion)[:, [skeleton.root]]
    result = set_bone_lengths(moved, lengths, skeleton)
    set_legs(result, nearer, np.full(motion.shape[:2], -np.inf), lengths, skeleton)
    return result


def set_legs(
    motion: Array, wanted: Array, floor: Array, lengths: Array, skeleton: Skeleton
) -> None:
    """Move knees and feet, in place, so that feet are where they are wanted and not below a floor.

    Parameters
    ----------
    motion : (..., J, 3) metres, with bones of the lengths
    wanted : (..., J, 3) metres, from which the places of ankles and the directions of feet are
    floor : (..., J) metres, height below which a joint must not be; -inf for all but feet
    lengths : (E,) metres
    skeleton : of the motion
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
) -> None:
    """Place knee and ankle of a leg; an ankle out of reach is placed in the target's direction.

    The knee stays on its side of the line from hip to ankle; one on the line bends ahead.
    """
    hip, knee, ankle = leg
    upper, lower = length_of[knee], length_of[ankle]
    start = motion[..., hip, :]
    line = target - start
    distance = np.linalg.norm(line, axis=-1, keepdims=True)
    reach = distance.clip(abs(upper - lower), upper + lower)
    along = resized(line, np.array(1.0))
    bend = _across(motion[..., knee, :] - start, along)
    for other in (ahead, np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])):
        is_straight = np.linalg.norm(bend, axis=-1, keepdims=True) < MIN_BEND
        bend = np.where(is_straight, _across(other, along), bend)
    forward = (upper**2 - lower**2 + reach**2) / (2 * np.maximum(reach, MIN_LENGTH))
    aside = np.sqrt(np.maximum(upper**2 - forward**2, 0))
    motion[..., knee, :] = start + forward * along + aside * resized(bend, np.array(1.0))
    motion[..., ankle, :] = start + reach * along


def _ahead(motion: Array, skeleton: Skeleton) -> Array:
    """``(..., 3)``: the direction in which the body faces, over the ground; zeros if not known."""
    knees = {skeleton.parents[foot[0]] for foot in feet(skeleton)}
    for left, right in skeleton.left_right:
        if {left, right} == knees:
            hips = [motion[..., skeleton.parents[knee], :] for knee in (left, right)]
            return np.cross(hips[0] - hips[1], [0.0, 1.0, 0.0])
    return np.zeros((*motion.shape[:-2], 3))


def _across(vectors: Array, along: Array) -> Array:
    """Return the part of vectors ``(..., 3)`` that is at right angles to unit vectors."""
    return np.asarray(vectors - (vectors * along).sum(axis=-1, keepdims=True) * along)


def raised(bone: Array, lowest: Array) -> Array:
    """Turn bones ``(..., 3)`` upwards about their start until they rise by ``lowest`` at least."""
    length = np.linalg.norm(bone, axis=-1)
    height = np.maximum(bone[..., 1], np.minimum(lowest, length))
    flat = np.linalg.norm(bone[..., [0, 2]], axis=-1)
    scale = np.sqrt(np.maximum(length**2 - height**2, 0)) / np.maximum(flat, MIN_LENGTH)
    return np.stack([scale * bone[..., 0], height, scale * bone[..., 2]], axis=-1)


def lengths_by_joint(lengths: Array, skeleton: Skeleton) -> dict[int, float]:
    """Return the length of the bone that ends at each joint but the root, metres."""
    return dict(zip(skeleton.bones[:, 1].tolist(), lengths.tolist(), strict=True))


def resized(bones: Array, lengths: Array) -> Array:
    """Give bones ``(..., 3)`` lengths ``(...)``; one of no length points down."""
    norm = np.linalg.norm(bones, axis=-1, keepdims=True)
    direction = np.where(norm > MIN_LENGTH, bones / np.maximum(norm, MIN_LENGTH), [0.0, -1.0, 0.0])
    return direction * lengths[..., None]
