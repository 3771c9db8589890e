"""Twists of limbs: how bones turn about their own length, which positions leave undetermined.

A joint may twist about its bone, and no joint beyond moves. Left to each frame, a twist jumps where
a bone points away from where the rest pose has it, or where a limb is nearly straight. Here the
twists of all frames are solved together: each is near what the parent carries along or what a hinge
wants, as far as the pose tells, and changes little from a frame to the next.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded

from pacmo_core.formats.inverse_kinematics import (
    ancestors,
    forward_kinematics,
    rotate_vectors,
    rotation_matrices,
)

Array = NDArray[np.float64]

# Weight of the twist that a bone takes over from its parent, relative to that by which a hinge,
# bent by a right angle, turns it: a limb that is nearly straight does not tell where its hinge is.
CARRIED_WEIGHT = 0.03
# Relative to it: below, a bone points so far from its rest that the twist carried along is any.
MIN_WEIGHT = 0.05 * CARRIED_WEIGHT
TINY = 1e-12


@dataclass(frozen=True)
class Hinge:
    """A knee or an elbow: the bone below it bends about one axis of the bone above.

    Parameters
    ----------
    joint, end : knee and ankle, or elbow and wrist; the bone above begins at the joint's parent
    axis : (3,) unit vector in the frame of that parent, about which a bend is positive
    """

    joint: int
    end: int
    axis: Array


@dataclass(frozen=True)
class Limbs:
    """Arms and legs, whose bones may twist.

    Parameters
    ----------
    starts : shoulders and hips; joints above them, of the trunk, are left alone
    hinges : of those that are known, by the joint at which the bone above begins
    smoothing : frames in which a twist follows that of a hinge that is bent by a right angle
    """

    starts: Collection[int]
    hinges: Mapping[int, Hinge]
    smoothing: float


def steady_twists(
    parents: Sequence[int],
    offsets: Array,
    local: Array,
    rest: Array,
    targets: Collection[int],
    limbs: Limbs,
) -> Array:
    """Twist the joints of limbs about their bones, steadily; no target moves.

    Of one joint, with its angles ``a`` of twist against frames that move without twisting:
    ``min_a sum_t w_t (a_t - b_t)^2 + smoothing^2 sum_t (a_t+1 - a_t)^2``. ``b`` is the angle of
    least rotation from the rest and, of a hinge, that by which the limb bends about the axis; the
    weight w falls to 0 where the rest is opposite, or the limb straight. Joints beyond the targets,
    such as fingers, are carried along.

    Parameters
    ----------
    offsets : (J, 3) from the parent, in the parent's frame
    local : (T, J, 3, 3), rotations against the parent
    rest : (J, 3, 3) of the same
    targets : joints whose positions are given

    Returns
    -------
    (T, J, 3, 3) against the parent
    """
    n_frames = len(local)
    moved = np.repeat(offsets[None], n_frames, axis=0)
    _, before = forward_kinematics(parents, np.zeros((n_frames, 3)), moved, local)
    inner = {joint for target in targets for joint in ancestors(parents, target)}
    twists = _free_twists(parents, {*inner, *targets}, limbs.starts)
    world, result = before.copy(), local.copy()
    for joint, parent in enumerate(parents):
        above = world[:, parent] if parent >= 0 else np.tile(np.eye(3), (n_frames, 1, 1))
        to_parent = above.swapaxes(1, 2)
        if joint in twists:
            along = _unit(offsets[twists[joint]])
            bone = rotate_vectors(to_parent @ before[:, joint], along)
            frames = _shortest_arcs(rest[joint] @ along, bone) @ rest[joint]
            pull = CARRIED_WEIGHT * (1 + bone @ (rest[joint] @ along)) / 2 + 0j
            if joint in limbs.hinges:
                hinge = limbs.hinges[joint]
                below = rotate_vectors(to_parent @ before[:, hinge.joint], offsets[hinge.end])
                pull += _hinge_pull(frames @ hinge.axis, bone, _unit(below))
            angles = _steady_angles(pull, _transport(frames, bone, along), limbs.smoothing)
            result[:, joint] = rotation_matrices(bone * angles[:, None]) @ frames
        elif joint in inner:
            result[:, joint] = to_parent @ before[:, joint]
        world[:, joint] = above @ result[:, joint]
    return result


def _free_twists(
    parents: Sequence[int], leading: Collection[int], starts: Collection[int]
) -> dict[int, int]:
    """Map joints of limbs to the one child towards targets, about whose bone they may twist."""
    twists = {}
    for joint in range(len(parents)):
        towards = [c for c, parent in enumerate(parents) if parent == joint and c in leading]
        if len(towards) == 1 and set(starts) & {joint, *ancestors(parents, joint)}:
            twists[joint] = towards[0]
    return twists


def _hinge_pull(axis: Array, bone: Array, below: Array) -> NDArray[np.complex128]:
    """``(T,)``: a twist that makes a limb bend about an axis, as an angle and a weight.

    The weight is the squared sine of the bend.
    """
    axis = axis - (axis * bone).sum(axis=-1, keepdims=True) * bone
    bend = np.cross(bone, below)
    bend *= np.linalg.norm(bend, axis=-1, keepdims=True)
    pull: NDArray[np.complex128] = (axis * bend).sum(axis=-1) + 1j * (
        np.cross(axis, bend) * bone
    ).sum(axis=-1)
    return pull


def _transport(frames: Array, bone: Array, along: Array) -> Array:
    """``(T,)`` radians: the twists against frames by which the first moves on without twisting."""
    normal = np.cross(along, np.eye(3)[np.abs(along).argmin()])
    here = frames @ normal
    moved = rotate_vectors(_shortest_arcs(bone[:-1], bone[1:]), here[:-1])
    sine = (np.cross(here[1:], moved) * bone[1:]).sum(axis=-1)
    steps = np.arctan2(sine, (here[1:] * moved).sum(axis=-1))
    return np.concatenate([[0.0], np.cumsum(steps)])


def _steady_angles(pull: NDArray[np.complex128], transport: Array, smoothing: float) -> Array:
    """``(T,)`` radians: the angles of least squares; they follow ``transport`` where none pulls."""
    weights = np.where(np.abs(pull) < MIN_WEIGHT, 0.0, np.abs(pull))
    known = weights > 0
    if not known.any():
        return transport
    wanted = np.zeros(len(pull))
    wanted[known] = np.unwrap((np.angle(pull) - transport)[known])
    # A tridiagonal system. Without smoothing, the nearest known angle is taken where none is.
    stiffness, links = max(smoothing, TINY) ** 2, np.ones(len(pull) - 1)
    diagonal = weights + stiffness * (np.pad(links, (1, 0)) + np.pad(links, (0, 1)))
    bands = np.stack([np.full(len(pull), -stiffness), diagonal])
    angles: Array = transport + solveh_banded(bands, weights * wanted)
    return angles


def _shortest_arcs(first: Array, second: Array) -> Array:
    """``(T, 3, 3)``: the smallest rotations from unit vectors to others, (T, 3) or (3,)."""
    first, second = np.broadcast_arrays(first, second)
    axis, cosine = np.cross(first, second), (first * second).sum(axis=-1)
    sine = np.linalg.norm(axis, axis=-1)
    # Opposite vectors have many; any of them will do.
    other = np.cross(first, np.eye(3)[np.abs(first).argmin(axis=-1)])
    axis = np.where((sine < TINY)[:, None], other, axis)
    return rotation_matrices(_unit(axis) * np.arctan2(sine, cosine)[:, None])


def _unit(vectors: Array) -> Array:
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    unit: Array = vectors / np.maximum(lengths, TINY)
    return unit
