"""Truth: forward kinematics written out joint by joint; our own reader of the published format."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from pacmo_core.data.interaction import bone_lengths
from pacmo_core.data.skeleton import DUET15, EXPI18, NTU25, SBU15, Skeleton
from pacmo_core.formats.bvh import read_bvh
from pacmo_core.formats.fit_bones import fit_bones
from pacmo_core.formats.write_bvh import format_bvh, zxy_angles
from tests.formats.moving import moving

BODIES = [NTU25, SBU15, DUET15, EXPI18]
MEAN, WORST = 1e-3, 5e-3  # metres


def read_back(text: str, folder: Path, skeleton: Skeleton) -> np.ndarray:
    file = folder / "out.bvh"
    file.write_text(text)
    bvh = read_bvh(file)
    return bvh.positions()[:, [bvh.joints.index(joint) for joint in skeleton.joints]]


@settings(derandomize=True, deadline=None, max_examples=10)
@given(st.sampled_from(BODIES), st.integers(0, 10_000))
def test_a_motion_of_constant_bones_is_read_back_where_it_was(
    tmp_path_factory: pytest.TempPathFactory, skeleton: Skeleton, seed: int
) -> None:
    motion = moving(skeleton, seed)
    places = read_back(format_bvh(motion, 30, skeleton), tmp_path_factory.mktemp("bvh"), skeleton)
    far = np.linalg.norm(places - motion, axis=-1)
    assert far.mean() <= MEAN
    assert far.max() <= WORST


def test_the_tree_the_rate_and_the_end_sites_are_as_the_reader_expects(tmp_path: Path) -> None:
    file = tmp_path / "out.bvh"
    file.write_text(format_bvh(moving(SBU15, 0), 120, SBU15))
    bvh = read_bvh(file)
    parents = {bvh.joints[i]: bvh.joints[p] for i, p in enumerate(bvh.parents) if p >= 0}
    for joint, parent in enumerate(SBU15.parents):
        if parent >= 0:
            assert parents[SBU15.joints[joint]] == SBU15.joints[parent]
    assert bvh.frame_time == pytest.approx(1 / 120, rel=1e-6)


def test_an_end_site_continues_its_bone_and_has_a_length(tmp_path: Path) -> None:
    file = tmp_path / "out.bvh"
    motion = moving(SBU15, 0)
    motion[:, SBU15.joints.index("left_foot")] = motion[:, SBU15.joints.index("left_knee")]
    file.write_text(format_bvh(motion, 120, SBU15))
    bvh = read_bvh(file)
    assert len(bvh.end_sites) == 5
    for end in bvh.end_sites:
        joint = bvh.parents[end]
        along, bone = bvh.offsets[end], bvh.offsets[joint]
        assert np.linalg.norm(along) > 0.01
        if bone.any():
            np.testing.assert_allclose(along, 0.1 * bone, atol=2e-6)


def test_bones_that_vary_get_their_median_length_and_joints_stay_near() -> None:
    random = np.random.default_rng(0)
    motion = moving(NTU25, 1, 40)
    shaken = (motion + random.normal(scale=0.005, size=motion.shape)).astype(np.float32)
    places = fit_bones(shaken, NTU25).positions(NTU25).astype(np.float32)
    np.testing.assert_allclose(
        bone_lengths(places, NTU25),
        np.tile(np.median(bone_lengths(shaken, NTU25), axis=0), (40, 1)),
        atol=1e-5,
    )
    # Handed down from joint to joint, errors of a bone would double on the whole.
    far = np.linalg.norm(places - shaken, axis=-1)
    assert far.mean() < 0.009
    assert far.max() < 0.06


@settings(derandomize=True, deadline=None)
@given(st.tuples(*[st.floats(-180, 180)] * 3), st.sampled_from([None, -90.0, 90.0]))
def test_angles_give_the_rotation_back_in_gimbal_lock_too(
    degrees: tuple[float, float, float], middle: float | None
) -> None:
    z, x, y = degrees
    wanted = Rotation.from_euler("ZXY", [z, x if middle is None else middle, y], degrees=True)
    (found,) = zxy_angles(wanted.as_matrix()[None])
    back = Rotation.from_euler("ZXY", found, degrees=True)
    np.testing.assert_allclose(back.as_matrix(), wanted.as_matrix(), atol=1e-5)


def test_a_joint_of_one_child_does_not_twist_against_its_parent() -> None:
    arm = Skeleton("arm", ("root", "left", "right", "hand"), (-1, 0, 0, 1), ((1, 2),))
    motion = np.zeros((5, 4, 3), np.float32)
    motion[:, 1] = [1, 0, 0]
    motion[:, 2] = [-1, 0.5, 0]
    bend = np.linspace(0, 1.5, 5)
    motion[:, 3] = motion[:, 1] + np.stack([np.cos(bend), np.sin(bend), 0 * bend], axis=-1)
    found = Rotation.from_matrix(fit_bones(motion, arm).rotations[:, 1]).as_rotvec()
    np.testing.assert_allclose(found[:, :2], 0, atol=1e-5)
    np.testing.assert_allclose(np.diff(found[:, 2]), np.diff(bend), atol=1e-5)
