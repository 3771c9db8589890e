"""Write BVH: a motion as a new file (metres, y up), a file with another body, or on a file's rig.

A rewritten file keeps its hierarchy, channels, unit and axes. Its own rotations are kept as far as
the new bone directions allow, so that what positions leave undetermined (the twist of a limb, the
rotation of a hand) stays as captured. Where several bones leave one joint, the angles between them
are fitted to the new motion, as a file holds them constant. A motion on a rig leaves the hierarchy
and all offsets as they are, and takes what positions leave undetermined from the file's mean pose.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.interaction import Motion
from pacmo_core.data.posture import upward_axis
from pacmo_core.data.segments import segments, upright_frames
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.formats.bvh import Bvh
from pacmo_core.formats.bvh_channels import (
    check_channels,
    displacements,
    format_file,
    local_rotations,
    rows_of,
)
from pacmo_core.formats.fit_bones import ConstantBoneMotion, fit_bones, reach_targets
from pacmo_core.formats.inverse_kinematics import (
    PointTargets,
    aim_bones,
    ancestors,
    forward_kinematics,
    inverse_kinematics,
    reach_points,
    rotate_vectors,
    steady_rotations,
)
from pacmo_core.formats.rotations import GIMBAL_LOCK, continuous_euler_angles, euler_angles_near
from pacmo_core.formats.scene_nodes import SceneNodes
from pacmo_core.formats.twist import Hinge, Limbs, steady_twists

# The rotation order: gimbal lock, where the middle angle is a right angle, lies where people look
# straight up or down.
ROTATION_CHANNELS = "Zrotation Xrotation Yrotation"
# Length of an End Site relative to the bone before it: short, as no joint of the motion is there.
END_SITE_SHARE = 0.1
# Of joints of the trunk on a rig, in square metres a squared radian: a bend of 20 degrees costs as
# much as an error of 3.5 cm of a joint.
TRUNK_STIFFNESS = 1e-2
# Of the pelvis, from its rotations filtered over time, and the filter's standard deviation.
PELVIS_STIFFNESS = 5e-2
STEADY_SECONDS = 0.15
TWIST_SECONDS = 0.1  # in which the twist of a limb follows that of a bent knee or elbow
MIN_BEND = 0.05  # mean sine of the angle by which a limb bends, below which it stays straight


def format_bvh(
    motion: Motion, fps: float, skeleton: Skeleton, weights: NDArray[np.float64] | None = None
) -> str:
    """Write a motion as the nearest one of constant bones (see ``fit_bones``).

    Every leaf of the hierarchy has an End Site that continues its bone a little: other programs
    reject or invent a bone of length zero.

    Parameters
    ----------
    motion : (T, J, 3) float32, metres, y up
    fps : frames a second
    weights : (T, J), of the squared error of each joint; without them each joint only points its
        bones to its children
    """
    fitted = fit_bones(motion, skeleton)
    if weights is not None:
        fitted = reach_targets(fitted, motion, weights, skeleton)
    return format_bvh_of_fit(fitted, fps, skeleton)


def format_bvh_of_fit(fitted: ConstantBoneMotion, fps: float, skeleton: Skeleton) -> str:
    """Write a motion of constant bones, in any unit and axes."""
    depth_first = list(_depth_first(skeleton, skeleton.root))
    columns = [fitted.root, *(zxy_angles(fitted.rotations[:, joint]) for joint in depth_first)]
    rows = np.concatenate(columns, axis=1)
    lines = [
        "HIERARCHY",
        *_hierarchy_lines(fitted, skeleton, skeleton.root, 0),
        "MOTION",
        f"Frames: {len(rows)}",
        f"Frame Time: {1 / fps:.9f}",
        *(" ".join(f"{value:.6f}" for value in row) for row in rows.tolist()),
    ]
    return "\n".join(lines) + "\n"


def zxy_angles(rotations: NDArray[np.float64]) -> NDArray[np.float64]:
    """``(T, 3)`` Euler angles of (T, 3, 3) in degrees about z, x, y, unwrapped over time."""
    r = rotations
    x = np.arcsin(r[:, 2, 1].clip(-1, 1))
    gimbal_locked = np.hypot(r[:, 0, 1], r[:, 1, 1]) < GIMBAL_LOCK
    y = np.where(gimbal_locked, 0.0, np.arctan2(-r[:, 2, 0], r[:, 2, 2]))
    free_z = np.arctan2(-r[:, 0, 1], r[:, 1, 1])
    z = np.where(gimbal_locked, np.arctan2(r[:, 1, 0], r[:, 0, 0]), free_z)
    angles: NDArray[np.float64] = np.degrees(np.unwrap(np.stack([z, x, y], axis=-1), axis=0))
    return angles


def _depth_first(skeleton: Skeleton, joint: int) -> Iterator[int]:
    yield joint
    for child, parent in enumerate(skeleton.parents):
        if parent == joint:
            yield from _depth_first(skeleton, child)


def _hierarchy_lines(
    fitted: ConstantBoneMotion, skeleton: Skeleton, joint: int, depth: int
) -> Iterator[str]:
    """Write a joint and all its descendants."""
    tab, name = "  " * depth, skeleton.joints[joint]
    root = joint == skeleton.root
    offset = " ".join(f"{value:.6f}" for value in fitted.offsets[joint])
    targets = "6 Xposition Yposition Zposition" if root else "3"
    yield f"{tab}{'ROOT' if root else 'JOINT'} {name}"
    yield f"{tab}{{"
    yield f"{tab}  OFFSET {offset}"
    yield f"{tab}  CHANNELS {targets} {ROTATION_CHANNELS}"
    children = [child for child, parent in enumerate(skeleton.parents) if parent == joint]
    for child in children:
        yield from _hierarchy_lines(fitted, skeleton, child, depth + 1)
    if not children:
        end = " ".join(f"{value:.6f}" for value in _end_offset(fitted.offsets, joint))
        yield from (f"{tab}  End Site", f"{tab}  {{", f"{tab}    OFFSET {end}", f"{tab}  }}")
    yield f"{tab}}}"


def _end_offset(offsets: NDArray[np.float64], joint: int) -> NDArray[np.float64]:
    """``(3,)``: from a leaf to its End Site, along its bone; along y if that has no length."""
    lengths = np.linalg.norm(offsets, axis=-1)
    bone = offsets[joint] if lengths[joint] else np.array([0.0, lengths.max() or 1.0, 0.0])
    return END_SITE_SHARE * bone


Array = NDArray[np.float64]


@dataclass(frozen=True)
class BvhTargets:
    """Where joints of a file shall be.

    Parameters
    ----------
    joints : the K joints that have targets, the root among them
    positions : (T, K, 3) file units, in the file's world
    weights : (T, K), of the squared distance of each joint from its target
    """

    joints: list[int]
    positions: Array
    weights: Array


def rewrite_bvh(file: Path, bvh: Bvh, targets: BvhTargets, scales: Array) -> str:
    """Write a file with other bone lengths and another motion (inverse kinematics on its channels).

    Parameters
    ----------
    file : for messages
    bvh : the file as read, with as many frames as ``targets``
    scales : (J,), of the bone that ends at each joint

    Raises
    ------
    FormatError
        If a joint has not three rotation channels, or the root no position channels.
    """
    nodes = SceneNodes.of(bvh)
    bvh, scales, first = nodes.body(), scales[nodes.joints], nodes.joints.start
    check_channels(file, bvh)
    positions = nodes.to_body(targets.positions)
    of_joint = {joint - first: positions[:, k] for k, joint in enumerate(targets.joints)}
    # Directions stay those of the rest pose: the rotations are also those of a character's skin.
    rest = bvh.offsets * scales[:, None]
    bones = displacements(bvh, bvh.offsets) * scales[:, None]
    initial = aim_bones(bvh.parents, of_joint, bones, local_rotations(bvh))
    root, local = inverse_kinematics(bvh.parents, of_joint, targets.weights, bones, initial)
    bones[:, 0] = root
    rows = rows_of(bvh, bones, local, euler_angles_near)
    return format_file(*nodes.whole(replace(bvh, offsets=rest), rows))


def write_on_rig(
    file: Path, bvh: Bvh, targets: PointTargets, model: Skeleton, unit: float, fps: float
) -> str:
    """Write a motion on the hierarchy and the bones of a file (inverse kinematics).

    Rotations start from the mean pose of the file's frames in which its person stands upright:
    joints that carry no target, such as fingers, keep it against their parents, and those of the
    trunk stay near it. Knees and elbows bend about the axes about which they bend in the file.

    Parameters
    ----------
    file : for messages
    bvh : the file as read
    targets : of the model's joints as points of the file's, in file units and the file's world
    model : whose joints the points are
    unit : metres per file unit
    fps : frames per second of the targets

    Raises
    ------
    FormatError
        If a joint has not three rotation channels, or the root no position channels.
    """
    nodes, up = SceneNodes.of(bvh), upward_axis(targets.positions, model)
    bvh, targets = nodes.body(), nodes.targets(targets)
    check_channels(file, bvh)
    n_frames = len(targets.positions)
    bones = displacements(bvh, bvh.offsets)
    turned = local_rotations(bvh)
    pose = _mean_rotations(turned[upright_frames(targets.shares @ bvh.positions(), model)])
    offsets, local = (
        np.repeat(values[None], n_frames, axis=0) for values in (bones.mean(axis=0), pose)
    )
    limbs = _limbs(targets.shares, model)
    forward = _forward(bvh.parents, offsets[:1], local[:1], limbs)
    hinges = {
        limb.start: Hinge(limb.bend, limb.end, axis)
        for limb in limbs
        if (axis := _hinge_axis(bvh.parents, bones, turned, limb, forward)) is not None
    }
    trunk = _trunk(bvh.parents, limbs)
    stiffness = dict.fromkeys(trunk, TRUNK_STIFFNESS / unit**2)
    initial = aim_bones(bvh.parents, targets.of_joints(), offsets, local)
    stiff = replace(targets, stiffness=stiffness, rest=pose)
    root, local = reach_points(bvh.parents, stiff, offsets, initial)
    # Hips nearly in one line leave the pelvis two poses, between which frames choose each alone.
    pelvis = sorted({bvh.parents[joint] for joint in trunk} - {-1, *trunk})
    steady = steady_rotations(bvh.parents, local, [*pelvis, *trunk], STEADY_SECONDS * fps)
    rest = np.repeat(pose[None], n_frames, axis=0)
    rest[:, pelvis] = steady[:, pelvis]
    stiffness |= dict.fromkeys(pelvis, PELVIS_STIFFNESS / unit**2)
    stiff = replace(targets, stiffness=stiffness, rest=rest)
    root, local = reach_points(bvh.parents, stiff, offsets, (root, steady))
    arms_and_legs = Limbs([limb.start for limb in limbs], hinges, TWIST_SECONDS * fps)
    rows = np.flatnonzero(targets.shares.any(axis=0)).tolist()
    local = steady_twists(bvh.parents, offsets[0], local, pose, rows, arms_and_legs)
    posed = replace(bvh, frame_time=1 / fps, motion=np.repeat(bvh.motion[:1], n_frames, axis=0))
    offsets[:, 0] = root
    rows_of_file = rows_of(posed, offsets, local, continuous_euler_angles)
    return format_file(*nodes.whole(posed, rows_of_file, up))


@dataclass(frozen=True)
class _Limb:
    """Joints of a file: shoulder, elbow and wrist, or hip, knee and ankle."""

    start: int
    bend: int
    end: int
    is_leg: bool
    is_left: bool


def _limbs(shares: Array, model: Skeleton) -> list[_Limb]:
    """Find the limbs of a file by those of the model whose joints are joints of the file."""
    joint_of = {
        row: int(np.flatnonzero(points)[0])
        for row, points in enumerate(shares)
        if np.count_nonzero(points) == 1
    }
    left = {pair[0] for pair in model.left_right}
    limbs = []
    for (bend, end), segment in zip(model.bones.tolist(), segments(model), strict=True):
        start = model.parents[bend]
        if segment.kind in ("forearm", "shin") and {start, bend, end} <= set(joint_of):
            kind = segment.kind == "shin", end in left
            limbs.append(_Limb(joint_of[start], joint_of[bend], joint_of[end], *kind))
    return limbs


def _trunk(parents: Sequence[int], limbs: Sequence[_Limb]) -> list[int]:
    """List the joints of spine, neck, head and collars: below the pelvis, and of no limb."""
    above = [[limb.start, *ancestors(parents, limb.start)] for limb in limbs]
    if not above:
        return []
    pelvis = max(set(above[0]).intersection(*above[1:]))
    starts = {limb.start for limb in limbs}
    chains = [(joint, [joint, *ancestors(parents, joint)]) for joint in range(len(parents))]
    return [
        joint
        for joint, chain in chains
        if joint != pelvis and pelvis in chain and not starts & set(chain)
    ]


def _forward(parents: Sequence[int], offsets: Array, local: Array, limbs: Sequence[_Limb]) -> Array:
    """``(J, 3)``: the direction in which the body of the mean pose faces, in each joint's frame.

    Zero for a body without two arms and two legs, or whose hips lie on a line with its shoulders.
    """
    positions, frames = forward_kinematics(parents, np.zeros((1, 3)), offsets, local)
    places = {(limb.is_leg, limb.is_left): positions[0, limb.start] for limb in limbs}
    if len(places) < len(("arm", "leg")) * len(("left", "right")):
        return np.zeros((len(parents), 3))
    left = places[True, True] - places[True, False]
    shoulders, hips = (places[leg, True] + places[leg, False] for leg in (False, True))
    forward = np.cross(left, shoulders - hips)
    in_frames: Array = forward @ frames[0] / max(float(np.linalg.norm(forward)), 1e-12)
    return in_frames


def _hinge_axis(
    parents: Sequence[int], bones: Array, turned: Array, limb: _Limb, forward: Array
) -> Array | None:
    """``(3,)``: the axis of a knee or an elbow in the frame of the bone above; None if not known.

    It is the mean of those about which the limb bends in the file, or where it stays straight, as
    in a file of a T-pose, that about which a forearm moves forward and a shin back.
    """
    if (parents[limb.bend], parents[limb.end]) != (limb.start, limb.bend):
        return None
    above, below = bones[:, limb.bend], rotate_vectors(turned[:, limb.bend], bones[:, limb.end])
    length = np.linalg.norm(above, axis=-1) * np.linalg.norm(below, axis=-1)
    axis: Array = np.mean(np.cross(above, below) / np.maximum(length, 1e-12)[:, None], axis=0)
    if np.linalg.norm(axis) < MIN_BEND:
        along = above.mean(axis=0) / np.linalg.norm(above.mean(axis=0))
        axis = np.cross(along, -forward[limb.start] if limb.is_leg else forward[limb.start])
    size = float(np.linalg.norm(axis))
    return axis / size if size > MIN_BEND else None


def _mean_rotations(rotations: Array) -> Array:
    """``(J, 3, 3)``: the rotations nearest to the means of (T, J, 3, 3) (Moakher 2002)."""
    u, _, right = np.linalg.svd(rotations.mean(axis=0))
    u[..., -1] *= np.linalg.det(u @ right)[:, None]
    mean: Array = u @ right
    return mean
