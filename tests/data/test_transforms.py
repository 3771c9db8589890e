"""Truth: rigid motions of the world, and a body built to face a known way."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pacmo_core.data.skeleton import DUET15, EXPI18, INTERHUMAN22, NTU25, SBU15, Skeleton
from pacmo_core.data.transforms import Frame, body_frame, line_between

SKELETONS = [NTU25, SBU15, DUET15, EXPI18, INTERHUMAN22]
ANGLES = st.floats(-3.1, 3.1)
SHIFTS = st.tuples(*[st.floats(-5, 5)] * 3)


def body(skeleton: Skeleton, n_frames: int = 4) -> np.ndarray:
    """Make a loose body that faces +z: left at x > 0, mirror images across the plane x = 0."""
    random = np.random.default_rng(len(skeleton.joints))
    pose = random.uniform(-0.5, 0.5, (len(skeleton.joints), 3))
    pose[:, 0] = 0
    for left, right in skeleton.left_right:
        pose[right] = pose[left]
        pose[left, 0], pose[right, 0] = 0.2, -0.2
    drift = np.linspace(0, 1, n_frames)[:, None, None] * random.uniform(-1, 1, pose.shape)
    return (pose + drift).astype(np.float32)


def world(yaw: float, shift: tuple[float, ...]) -> Frame:
    return Frame(origin=np.array(shift), yaw=yaw)


@pytest.mark.parametrize("skeleton", SKELETONS, ids=lambda s: s.name)
def test_a_body_built_to_face_z_has_no_yaw_and_its_root_at_the_origin(skeleton: Skeleton) -> None:
    motion = body(skeleton)
    frame = body_frame(motion, skeleton)
    assert frame.yaw == pytest.approx(0, abs=1e-6)
    np.testing.assert_allclose(frame.to_local(motion)[0, skeleton.root], 0, atol=1e-6)


@settings(derandomize=True, deadline=None)
@given(yaw=ANGLES, shift=SHIFTS, skeleton=st.sampled_from(SKELETONS))
def test_the_local_motion_does_not_change_when_the_world_turns_and_shifts(
    yaw: float, shift: tuple[float, ...], skeleton: Skeleton
) -> None:
    motion = body(skeleton)
    moved = world(yaw, shift).to_world(motion)
    there, here = body_frame(moved, skeleton), body_frame(motion, skeleton)
    np.testing.assert_allclose(there.to_local(moved), here.to_local(motion), atol=1e-5)


@settings(derandomize=True, deadline=None)
@given(yaw=ANGLES, shift=SHIFTS)
def test_to_world_undoes_to_local(yaw: float, shift: tuple[float, ...]) -> None:
    motion, frame = body(SBU15), world(yaw, shift)
    np.testing.assert_allclose(frame.to_world(frame.to_local(motion)), motion, atol=2e-6)
    assert frame.to_local(motion).dtype == np.float32


def test_a_yaw_turns_z_towards_x() -> None:
    ahead = np.array([[0, 0, 1]], dtype=np.float32)
    np.testing.assert_allclose(world(np.pi / 2, (0, 0, 0)).to_world(ahead), [[1, 0, 0]], atol=1e-7)


def test_hips_that_share_the_roots_place_give_way_to_the_next_pair() -> None:
    names = ("root", "lhip", "rhip", "lfemur", "rfemur")
    skeleton = Skeleton("hips", names, (-1, 0, 0, 1, 2), ((1, 2), (3, 4)))
    pose = np.zeros((1, 5, 3), dtype=np.float32)
    pose[0, 3], pose[0, 4] = (0, 0, -0.1), (0, 0, 0.1)  # left is at -z: faces +x
    assert body_frame(pose, skeleton).yaw == pytest.approx(np.pi / 2)


def test_a_body_without_a_heading_is_refused() -> None:
    pose = np.zeros((1, 15, 3), dtype=np.float32)
    with pytest.raises(ValueError, match="heading"):
        body_frame(pose, SBU15)


def test_the_line_between_two_who_change_sides_is_where_they_are_apart() -> None:
    share = np.linspace(-1.0, 1.1, 40)[:, None]
    first, second = np.zeros((40, 3)), share * [1.2, 0.0, 0.0] + [0.0, 0.3, 0.05]
    assert line_between(first, second) == pytest.approx(0, abs=0.05)
    # The mean distance points aside.
    apart = (second - first).mean(axis=0)
    assert abs(apart[0]) < 2 * abs(apart[2])
    turned = second @ np.array([[0, 0, -1], [0, 1, 0], [1, 0, 0]])  # x becomes -z
    assert line_between(first, turned) == pytest.approx(np.pi / 2, abs=0.05)
