"""Truth: legs of known bones, places of feet that they reach or not, the plane of a knee."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pacmo_core.data.interaction import bone_lengths
from pacmo_core.data.skeleton import NTU25, Skeleton
from pacmo_core.finish.bones import (
    median_lengths,
    raised,
    set_bone_lengths,
    set_legs,
)
from tests.finish.test_floor import LEG, standing

HIP, KNEE, ANKLE, FOOT = NTU25.indices(["left_hip", "left_knee", "left_ankle", "left_foot"])
NO_FLOOR = np.full((20, 25), -np.inf)


def placed(shift: np.ndarray, floor: np.ndarray = NO_FLOOR) -> tuple[np.ndarray, np.ndarray]:
    """Return a body whose left foot is wanted elsewhere, and where it is wanted."""
    motion = standing(LEG).astype(np.float64)
    lengths = median_lengths(motion, NTU25)
    wanted = motion.copy()
    wanted[:, [ANKLE, FOOT]] += shift
    set_legs(motion, wanted, floor, lengths, NTU25)
    np.testing.assert_allclose(bone_lengths(motion, NTU25), np.tile(lengths, (20, 1)), atol=1e-6)
    return motion, wanted


@settings(derandomize=True, deadline=None, max_examples=20)
@given(st.floats(-0.2, 0.2), st.floats(0.05, 0.5), st.floats(-0.2, 0.2))
def test_a_foot_within_reach_is_where_it_is_wanted(x, y, z):
    motion, wanted = placed(np.array([x, y, z]))
    np.testing.assert_allclose(motion[:, [ANKLE, FOOT]], wanted[:, [ANKLE, FOOT]], atol=1e-6)


def test_a_straight_knee_bends_ahead():
    motion, _ = placed(np.array([0, 0.2, 0]))
    # The toes are ahead, at greater z.
    assert (motion[:, KNEE, 2] > motion[:, HIP, 2] + 0.1).all()


def test_a_foot_out_of_reach_is_in_its_direction():
    motion, wanted = placed(np.array([1.0, 0, 0]))
    line, found = wanted[0, ANKLE] - wanted[0, HIP], motion[0, ANKLE] - motion[0, HIP]
    assert np.linalg.norm(found) == pytest.approx(LEG, abs=1e-6)
    np.testing.assert_allclose(np.cross(line, found), 0, atol=1e-6)


def test_no_joint_of_a_foot_is_below_the_floor():
    floor = NO_FLOOR.copy()
    floor[:, ANKLE], floor[:, FOOT] = 0.2, 0.15
    motion, _ = placed(np.zeros(3), floor)
    assert (motion[:, [ANKLE, FOOT], 1] >= floor[:, [ANKLE, FOOT]] - 1e-9).all()


def test_a_raised_bone_keeps_its_length_and_its_heading():
    bone = np.array([[0.3, -0.4, 0.0], [0.0, 0.2, 0.1]])
    found = raised(bone, np.array([0.1, 0.1]))
    np.testing.assert_allclose(found[0], [np.sqrt(0.25 - 0.01), 0.1, 0])
    np.testing.assert_allclose(found[1], bone[1])


def test_bones_of_no_length_point_down():
    skeleton = Skeleton("two", ("root", "tip"), (-1, 0))
    motion = np.zeros((3, 2, 3))
    np.testing.assert_allclose(
        set_bone_lengths(motion, np.array([0.2]), skeleton)[:, 1], [[0, -0.2, 0]] * 3
    )
