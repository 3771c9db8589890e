"""Truth: the same person without nodes above the hips."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.formats.bvh import Bvh, read_bvh
from pacmo_core.formats.bvh_channels import format_file
from pacmo_core.formats.inverse_kinematics import PointTargets
from pacmo_core.formats.registry import read_partner
from pacmo_core.formats.scene_nodes import SceneNodes, _moved
from pacmo_core.formats.write_bvh import BvhTargets, format_bvh, rewrite_bvh, write_on_rig
from tests.formats.rigged import mixamo, people

SIX = (*("xposition", "yposition", "zposition"), *("zrotation", "xrotation", "yrotation"))
SETTINGS = {"unit": 1.0, "up": "y"}
NODE = np.array([0.3, -0.2, 0.5, 90.0, 20.0, -30.0])  # where the last node stands, and is turned


@pytest.fixture
def plain(tmp_path: Path) -> Path:
    """Write a person whose hips are the root."""
    skeleton, (motion, _) = mixamo(people().frames(0, 20), prefix="")
    file = tmp_path / "plain.bvh"
    file.write_text(format_bvh(motion, 30, skeleton))
    return file


def below_nodes(file: Path, *, moves: bool = False) -> Path:
    """Put an armature that is turned, and a second one, above the hips.

    The first may move, as the root of a game's character does, and carries the person with it.
    """
    bvh = read_bvh(file)
    motion = np.concatenate([np.tile(NODE, (len(bvh.motion), 1)), np.zeros((20, 6))], axis=1)
    motion[:, :6] += np.arange(20)[:, None] * moves * np.array([0.03, 0.01, -0.02, 5, 1, -2])
    joints = ("Armature", "Reference", *bvh.joints)
    parents = (-1, 0, 1, *(parent + 2 for parent in bvh.parents[1:]))
    nodes = Bvh(
        joints=joints,
        parents=parents,
        offsets=np.concatenate([np.zeros((2, 3)), bvh.offsets]),
        channels=(SIX, SIX, *bvh.channels),
        end_sites=tuple(end + 2 for end in bvh.end_sites),
        frame_time=bvh.frame_time,
        motion=np.concatenate([motion, bvh.motion], axis=1),
    )
    written = file.with_name(f"nodes{moves:d}.bvh")
    written.write_text(format_file(nodes, nodes.motion))
    return written


def beside_helpers(file: Path) -> Path:
    """Put a root above the hips, as of Unreal, and helpers before and after them that move."""
    bvh = read_bvh(file)
    shift = {-1: 0} | {joint: joint + 2 for joint in range(len(bvh.joints))}
    moving = np.random.default_rng(3).normal(size=(len(bvh.motion), 6))
    last = len(bvh.joints) + 2
    helpers = Bvh(
        joints=("root", "ik_foot_root", *bvh.joints, "ik_hand_root"),
        parents=(-1, 0, *(shift[parent] for parent in bvh.parents), 0),
        offsets=np.concatenate([np.zeros((2, 3)), bvh.offsets, np.zeros((1, 3))]),
        channels=(SIX, SIX, *bvh.channels, SIX),
        end_sites=tuple(end + 2 for end in bvh.end_sites),
        frame_time=bvh.frame_time,
        motion=np.concatenate([np.zeros((20, 6)), moving, bvh.motion, moving], axis=1),
    )
    assert len(helpers.joints) == last + 1
    written = file.with_name("helpers.bvh")
    written.write_text(format_file(helpers, helpers.motion))
    return written


def person_of(file: Path) -> tuple[Skeleton, np.ndarray]:
    person = read_partner(file, "bvh", SETTINGS, person=None, clip="")
    return person.skeleton, person.motion


@pytest.mark.parametrize("moves", [False, True])
def test_nodes_above_the_hips_are_no_joints_of_the_body(plain: Path, *, moves: bool) -> None:
    file = below_nodes(plain, moves=moves)
    bvh = read_bvh(file)
    nodes = SceneNodes.of(bvh)
    assert nodes.above == (0, 1)
    in_body = nodes.to_body(bvh.positions()[:, 2:])
    np.testing.assert_allclose(nodes.body().positions(), in_body, atol=1e-4)
    still = slice(1) if moves else slice(None)
    np.testing.assert_allclose(in_body[still], read_bvh(plain).positions()[still], atol=1e-4)
    (skeleton, motion), (known, _) = person_of(file), person_of(plain)
    assert (skeleton.joints, skeleton.parents) == (known.joints, known.parents)
    joints = [bvh.joints.index(joint) for joint in skeleton.joints]
    np.testing.assert_allclose(motion, bvh.positions()[:, joints], atol=1e-5)


def test_hips_that_are_the_root_and_a_chain_without_a_body_stay(plain: Path) -> None:
    bvh = read_bvh(plain)
    assert SceneNodes.of(bvh).above == ()
    chain = replace(bvh, joints=("a", "b", "c"), parents=(-1, 0, 1), offsets=np.zeros((3, 3)),
                    channels=(SIX, SIX, SIX), end_sites=(), motion=np.zeros((2, 18)))  # fmt: skip
    assert SceneNodes.of(chain).body().joints == chain.joints


@pytest.mark.parametrize("moves", [False, True])
def test_a_file_that_is_written_again_keeps_its_nodes(plain: Path, *, moves: bool) -> None:
    file = below_nodes(plain, moves=moves)
    bvh, (skeleton, motion) = read_bvh(file), person_of(file)
    shifted = motion + np.float32([0.5, 0.1, -0.4])
    joints = [bvh.joints.index(joint) for joint in skeleton.joints]
    weights = np.ones(motion.shape[:2])
    targets = BvhTargets(joints, shifted.astype(np.float64), weights)
    file.write_text(rewrite_bvh(file, bvh, targets, np.ones(len(bvh.joints))))
    again = read_bvh(file)
    np.testing.assert_allclose(again.motion[:, :12], bvh.motion[:, :12], atol=1e-5)
    np.testing.assert_allclose(person_of(file)[1], shifted, atol=2e-3)


@pytest.mark.parametrize(("moves", "n_frames"), [(False, 20), (True, 20), (True, 13)])
def test_a_motion_on_a_rig_moves_the_hips_and_not_its_nodes(
    plain: Path, *, moves: bool, n_frames: int
) -> None:
    file = below_nodes(plain, moves=moves)
    bvh, (skeleton, motion) = read_bvh(file), person_of(file)
    motion = motion[:n_frames]
    shifted = (motion + np.float32([0.5, 0, -0.4])).astype(np.float64)
    shares = np.zeros((len(skeleton.joints), len(bvh.joints)))
    shares[np.arange(len(shares)), [bvh.joints.index(joint) for joint in skeleton.joints]] = 1
    targets = PointTargets(shares, shifted, np.ones(motion.shape[:2]))
    file.write_text(write_on_rig(file, bvh, targets, skeleton, 1.0, 30))
    again = read_bvh(file)
    if not moves:
        np.testing.assert_allclose(again.motion[:, :12], bvh.motion[:, :12], atol=1e-5)
    assert np.abs(person_of(file)[1] - shifted).mean() < 0.02


def test_the_root_of_a_game_character_goes_beneath_the_hips_of_another_motion(plain: Path) -> None:
    skeleton, motion = person_of(plain)
    bvh = read_bvh(plain)
    hips = bvh.joints.index(skeleton.joints[skeleton.root])
    way = np.arange(20)[:, None] * np.array([0.04, 0, 0.01])
    # The root stands on the floor, and carries the person; it does not turn.
    root = np.concatenate([motion[:1, 0] * [1, 0, 1] + way, np.zeros((20, 3))], axis=1)
    carried = bvh.motion.copy()
    carried[:, :3] -= root[:, :3]
    rooted = replace(
        bvh, joints=("root", *bvh.joints), parents=(-1, *(p + 1 for p in bvh.parents)),
        offsets=np.concatenate([np.zeros((1, 3)), bvh.offsets]), channels=(SIX, *bvh.channels),
        end_sites=tuple(end + 1 for end in bvh.end_sites),
        motion=np.concatenate([root, carried], axis=1),
    )  # fmt: skip
    nodes = SceneNodes.of(rooted)
    assert nodes.above == (0,)
    body = nodes.body()
    # The person of thirteen other frames, who turns by 90 degrees about y and walks.
    quarter = np.array([[0, 0, 1.0], [0, 1, 0], [-1, 0, 0]])
    turned = _moved(
        replace(body, motion=body.motion[:13]), np.tile([1.0, 0, 2.0], (13, 1)),
        np.tile(quarter, (13, 1, 1)),
    )  # fmt: skip
    whole, rows = nodes.whole(body, turned, up=1)
    placed = replace(whole, motion=rows)
    wanted = replace(body, motion=turned)
    np.testing.assert_allclose(
        placed.positions()[:, 1:], wanted.positions() + root[0, :3], atol=1e-5
    )
    np.testing.assert_allclose(rows[:, 1], 0, atol=1e-9)  # on the floor
    np.testing.assert_allclose(rows[:, [3, 4]], 0, atol=1e-6)  # upright
    first = bvh.motion[0, :3] - root[0, :3]
    beside = placed.positions()[:, hips + 1] - rows[:, :3]
    np.testing.assert_allclose(beside[0], quarter @ first, atol=1e-5)
    np.testing.assert_allclose(rows[0, 5], 90, atol=1e-5)


def test_helpers_beside_the_body_are_no_joints_and_keep_their_motion(plain: Path) -> None:
    file = beside_helpers(plain)
    bvh = read_bvh(file)
    (skeleton, motion), (known, expected) = person_of(file), person_of(plain)
    assert skeleton.joints == known.joints
    np.testing.assert_allclose(motion, expected, atol=1e-5)
    joints = [bvh.joints.index(joint) for joint in skeleton.joints]
    shifted = (motion + np.float32([0.5, 0.1, -0.4])).astype(np.float64)
    targets = BvhTargets(joints, shifted, np.ones(motion.shape[:2]))
    file.write_text(rewrite_bvh(file, bvh, targets, np.ones(len(bvh.joints))))
    again = read_bvh(file)
    assert again.joints == bvh.joints
    np.testing.assert_allclose(again.motion[:, :12], bvh.motion[:, :12], atol=1e-5)
    np.testing.assert_allclose(again.motion[:, -6:], bvh.motion[:, -6:], atol=1e-5)
    np.testing.assert_allclose(person_of(file)[1], shifted, atol=2e-3)
