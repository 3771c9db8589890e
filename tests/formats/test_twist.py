"""Truth: limbs that are posed by known rotations, and a rig with fingers."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from pacmo_core.data.skeleton import Skeleton, mirror_by_name
from pacmo_core.formats.bvh import Bvh, read_bvh
from pacmo_core.formats.inverse_kinematics import PointTargets, forward_kinematics
from pacmo_core.formats.joint_names import StatedNames, name_joints
from pacmo_core.formats.twist import Hinge, Limbs, steady_twists
from pacmo_core.formats.write_bvh import format_file, write_on_rig
from tests.formats.rigged import people, t_pose

FPS = 30
# Shoulder, elbow, wrist, middle finger, thumb; the arm hangs down.
PARENTS = (-1, 0, 1, 2, 2)
OFFSETS = np.array([[0, 0, 0], [0, -0.3, 0], [0, -0.3, 0], [0, -0.1, 0], [0.05, -0.05, 0.0]])
AXIS = np.array([1.0, 0, 0])
TARGETS = [0, 1, 2, 3]


def turns(rotations: np.ndarray) -> np.ndarray:
    """Return the angle from a frame to the next, (T - 1, J) degrees."""
    steps = rotations[:-1].swapaxes(-1, -2) @ rotations[1:]
    angles = Rotation.from_matrix(steps.reshape(-1, 3, 3)).magnitude()
    return np.degrees(angles).reshape(steps.shape[:2])


def posed(local: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    n_frames = len(local)
    offsets = np.repeat(OFFSETS[None], n_frames, axis=0)
    return forward_kinematics(PARENTS, np.zeros((n_frames, 3)), offsets, local)


def steady(local: np.ndarray, *, smoothing: float = 3.0, hinge: bool = True) -> np.ndarray:
    rest = np.tile(np.eye(3), (len(PARENTS), 1, 1))
    limbs = Limbs([0], {0: Hinge(1, 2, AXIS)} if hinge else {}, smoothing)
    return steady_twists(PARENTS, OFFSETS, local, rest, TARGETS, limbs)


def straight(n_frames: int) -> np.ndarray:
    return np.tile(np.eye(3), (n_frames, len(PARENTS), 1, 1))


def test_no_target_moves_and_what_a_hand_carries_turns_with_it() -> None:
    local = straight(20)
    local[:] = Rotation.random(100, random_state=0).as_matrix().reshape(20, 5, 3, 3)
    found = steady(local)
    np.testing.assert_allclose(posed(found)[0][:, TARGETS], posed(local)[0][:, TARGETS], atol=1e-9)
    np.testing.assert_allclose(found[:, 3:], local[:, 3:], atol=1e-12)
    assert np.abs(found[:, :3] - local[:, :3]).max() > 0.1


def test_a_limb_bends_about_the_axis_of_its_hinge() -> None:
    random = np.random.default_rng(9)
    local = straight(20)
    local[:, 0] = Rotation.random(20, random_state=9).as_matrix()
    bends = random.uniform(0.5, 2.4, 20)
    local[:, 1] = Rotation.from_rotvec(np.outer(bends, AXIS)).as_matrix()
    # Both twisted by any angle, so that no target moves.
    twists = Rotation.from_rotvec(np.outer(random.uniform(-3, 3, 20), OFFSETS[1] / 0.3)).as_matrix()
    given = local.copy()
    given[:, 0] = local[:, 0] @ twists
    given[:, 1] = twists.swapaxes(1, 2) @ local[:, 1]
    found = Rotation.from_matrix(steady(given, smoothing=0)[:, 1]).as_rotvec()
    assert np.abs(found[:, 1:]).max() < 0.15
    np.testing.assert_allclose(found[:, 0], bends, atol=0.02)
    free = Rotation.from_matrix(steady(given, smoothing=0, hinge=False)[:, 1]).as_rotvec()
    assert np.abs(free[:, 1:]).max() > 1


def test_a_bone_that_points_opposite_to_its_rest_twists_no_faster_than_it_moves() -> None:
    phase = np.linspace(0, 4 * np.pi, 121)
    local = straight(121)
    overhead = Rotation.from_euler("x", 180, degrees=True)
    circle = np.stack([np.cos(phase), 0 * phase, np.sin(phase)], axis=-1)
    local[:, 0] = (Rotation.from_rotvec(np.radians(8) * circle) * overhead).as_matrix()
    given = local.copy()
    given[:, 0] = local[:, 0] @ Rotation.from_rotvec(np.outer(3 * phase, [0, 1, 0])).as_matrix()
    _, world = posed(steady(given))
    assert turns(world).max() < 1.2 * turns(posed(local)[1]).max()


def test_a_hinge_that_bends_the_other_way_twists_its_bone_over_several_frames() -> None:
    bends = np.where(np.arange(60) < 30, 0.6, -0.6)
    local = straight(60)
    local[:, 1] = Rotation.from_rotvec(np.outer(bends, AXIS)).as_matrix()
    found = steady(local)
    assert turns(found[:, :1]).max() < 25
    assert np.degrees(Rotation.from_matrix(found[[0, -1], 0]).magnitude())[1] > 150


def rotation_column(bvh: Bvh, joint: str, channel: str) -> int:
    columns = [(name, c) for name, of in zip(bvh.joints, bvh.channels, strict=True) for c in of]
    return columns.index((f"mixamorig:{joint}", f"{channel}rotation"))


def test_no_bone_of_a_rig_with_fingers_turns_twice_as_fast_as_the_person(tmp_path: Path) -> None:
    """Arms hang in the rig's file; the person waves a straight arm overhead."""
    file = tmp_path / "rig.bvh"
    file.write_text(t_pose())
    bvh = read_bvh(file)
    for side, sign in (("Left", -1), ("Right", 1)):
        bvh.motion[:, rotation_column(bvh, f"{side}Arm", "z")] = 85 * sign
    file.write_text(format_file(bvh, bvh.motion))
    rig = read_bvh(file)
    phase = np.linspace(0, 4 * np.pi, 61)
    rows = np.repeat(rig.motion[:1], len(phase), axis=0)
    rows[:, rotation_column(rig, "LeftArm", "z")] = 95 + 8 * np.cos(phase)
    rows[:, rotation_column(rig, "LeftArm", "y")] = 8 * np.sin(phase)
    rows[:, rotation_column(rig, "LeftForeArm", "y")] = -5
    truth = replace(rig, motion=rows).positions()

    body = people().skeleton
    model = body.without(j for j in body.joints if j.endswith(("hand_tip", "thumb")))
    joints = [row for row in range(len(rig.joints)) if row not in rig.end_sites]
    names = tuple(rig.joints[row] for row in joints)
    parents = tuple(joints.index(p) if (p := rig.parents[row]) >= 0 else -1 for row in joints)
    skeleton = Skeleton("rig", names, parents, mirror_by_name(names))
    shares = np.zeros((len(model.joints), len(rig.joints)))
    shares[:, joints] = name_joints(skeleton, model, StatedNames()).weights
    targets = PointTargets(shares, shares @ truth, np.ones((len(phase), len(shares))))
    other = tmp_path / "other.bvh"
    other.write_text(write_on_rig(file, rig, targets, model, 0.01, FPS))
    written = read_bvh(other).positions()
    errors = np.linalg.norm(shares @ (written - truth), axis=-1)
    assert errors.mean() < 0.5  # cm
    assert bone_turns(rig, written).max() < 2 * bone_turns(rig, truth).max()


def bone_turns(bvh: Bvh, positions: np.ndarray) -> np.ndarray:
    """Return ``(T - 1, E)`` degrees, of all bones of a file."""
    child = [row for row, parent in enumerate(bvh.parents) if parent >= 0]
    bones = positions[:, child] - positions[:, [bvh.parents[row] for row in child]]
    sines = np.linalg.norm(np.cross(bones[:-1], bones[1:]), axis=-1)
    return np.degrees(np.arctan2(sines, (bones[:-1] * bones[1:]).sum(axis=-1)))
