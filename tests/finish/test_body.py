"""Truth: a body that stands as it did, and a pelvis whose root is elsewhere over the hips."""

import numpy as np
import pytest

from pacmo_core.data.interaction import bone_lengths
from pacmo_core.data.segments import upright_frames
from pacmo_core.data.skeleton import NTU25, Skeleton
from pacmo_core.finish.body import TargetBody, body_of, find_pelvis, with_body
from tests.finish.test_floor import LEG, standing

HIPS = NTU25.indices(["left_hip", "right_hip"])
ANKLES = NTU25.indices(["left_ankle", "right_ankle"])
LEG_JOINTS = ("hip", "knee", "ankle", "foot")
GROUND = np.full(20, 0.3)


def body_above_ground() -> np.ndarray:
    motion = standing(LEG).astype(np.float64)
    motion[:, :, 1] += 0.3
    return motion


@pytest.mark.parametrize("size", [0.6, 1.0, 1.2])
def test_a_body_of_another_size_stands_where_it_stood(size):
    motion = body_above_ground()
    own = body_of(motion.astype(np.float32), NTU25)
    assert own.root is not None
    body = TargetBody(size * own.lengths, size * own.root, size * own.hip_distance)
    found = with_body(motion, body, GROUND, NTU25)
    lengths = np.tile(body.lengths, (20, 1))
    np.testing.assert_allclose(bone_lengths(found, NTU25), lengths, atol=1e-6)
    # Feet keep their places over the ground, and all heights are in proportion.
    np.testing.assert_allclose(
        found[:, ANKLES][..., [0, 2]], motion[:, ANKLES][..., [0, 2]], atol=1e-3
    )
    for joints, tolerance in ((ANKLES, 3e-3), ([NTU25.root], 1e-3)):
        np.testing.assert_allclose(
            found[:, joints, 1], 0.3 + size * (motion[:, joints, 1] - 0.3), atol=tolerance
        )
    if size == 1.0:
        np.testing.assert_allclose(found, motion, atol=1e-3)


def test_a_root_high_over_the_hips_neither_spreads_them_nor_lifts_the_legs():
    motion = body_above_ground()
    turn = np.array([[0.6, 0, 0.8], [0, 1, 0], [-0.8, 0, 0.6]])
    motion = motion @ turn.T
    # SMPL's root: 9 cm over hips that are 12 cm apart, in place of Kinect's.
    other = motion.copy()
    left = motion[:, HIPS[0]] - motion[:, HIPS[1]]
    left /= np.linalg.norm(left, axis=-1, keepdims=True)
    middle = motion[:, HIPS].mean(axis=1)
    other[:, HIPS[0]], other[:, HIPS[1]] = middle + 0.06 * left, middle - 0.06 * left
    other[:, NTU25.root] = middle + np.array([0, 0.09, 0])
    body = body_of(other.astype(np.float32), NTU25)
    np.testing.assert_allclose(body.root, [0, 0.09, 0], atol=1e-5)
    found = with_body(motion, body, GROUND, NTU25)
    np.testing.assert_allclose(
        bone_lengths(found, NTU25), np.tile(body.lengths, (20, 1)), atol=1e-5
    )
    # Its thighs are 2 mm longer, as they begin elsewhere.
    np.testing.assert_allclose(found[:, HIPS], other[:, HIPS], atol=3e-3)
    np.testing.assert_allclose(found[:, NTU25.root], other[:, NTU25.root], atol=3e-3)
    np.testing.assert_allclose(found[:, ANKLES], motion[:, ANKLES], atol=3e-3)


def test_without_hips_a_body_is_its_bones_alone():
    chain = Skeleton("chain", ("root", "middle", "tip"), (-1, 0, 1))
    motion = np.zeros((4, 3, 3))
    motion[:, 1, 1], motion[:, 2, 1] = 1, 3
    body = body_of(motion.astype(np.float32), chain)
    assert find_pelvis(chain) is None and body.root is None
    longer = TargetBody(2 * body.lengths)
    found = with_body(motion, longer, np.zeros(4), chain)
    np.testing.assert_allclose(bone_lengths(found, chain), [[2, 4]] * 4, atol=1e-9)


def test_the_upright_frames_are_those_of_the_longest_trunk():
    upper = [j for j, name in enumerate(NTU25.joints) if not name.endswith(LEG_JOINTS)]
    motion = np.repeat(standing(LEG)[:1], 8, axis=0)
    motion[:, upper, 1] += 0.5 * (np.arange(len(upper)) > 0)
    motion[2:, upper[1:], 1] -= 0.1
    assert upright_frames(motion, NTU25).tolist() == [True, True] + [False] * 6
