"""Trusted: rotations keep lengths, and the law of cosines says where an elbow can be."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from pacmo_core.synthesis.kinematics import (
    MAX_EXTENSION,
    MIN_EXTENSION,
    Array,
    rotation_x,
    rotation_y,
    rotation_z,
    two_bone_ik,
)

ANGLES = np.linspace(-3, 3, 13)


@pytest.mark.parametrize("rotate", [rotation_y, rotation_x, rotation_z])
def test_rotations_are_proper(rotate: Callable[[Array], Array]) -> None:
    matrices = rotate(ANGLES)
    assert matrices @ matrices.transpose(0, 2, 1) == pytest.approx(
        np.tile(np.eye(3), (13, 1, 1)), abs=1e-12
    )
    assert np.linalg.det(matrices) == pytest.approx(1.0)


def test_angles_turn_the_way_their_docstrings_say() -> None:
    quarter = np.array([np.pi / 2])
    assert rotation_y(quarter)[0] @ [0, 0, 1] == pytest.approx([1, 0, 0])  # ahead goes to the left
    assert rotation_x(quarter)[0] @ [0, 1, 0] == pytest.approx([0, 0, 1])  # up goes forward
    assert rotation_z(quarter)[0] @ [0, 1, 0] == pytest.approx([-1, 0, 0])  # up goes to the right


def _pole(goal: tuple[float, float, float]) -> NDArray[np.float64]:
    """Across the limb."""
    return np.cross(np.array([goal]), [0.3, 0.5, -0.8])


@settings(derandomize=True, max_examples=100)
@given(
    goal=st.tuples(*[st.floats(-1, 1)] * 3),
    upper=st.floats(0.25, 0.4),
    lower=st.floats(0.25, 0.4),
)
def test_a_limb_keeps_its_bones_and_bends_to_its_pole(
    goal: tuple[float, float, float], upper: float, lower: float
) -> None:
    root = np.array([[0.1, 0.2, 0.3]])
    goals = root + np.array([goal])
    pole = _pole(goal)
    assume(np.linalg.norm(pole) > 0.01)
    middle, end = two_bone_ik(root, goals, (upper, lower), pole)
    assert np.linalg.norm(middle - root) == pytest.approx(upper, abs=1e-9)
    assert np.linalg.norm(end - middle) == pytest.approx(lower, abs=1e-9)
    assert ((middle - root) * pole).sum() > 0
    length, far = upper + lower, float(np.linalg.norm(goal))
    if MIN_EXTENSION * length + 0.03 < far < MAX_EXTENSION * length - 0.03:
        assert end == pytest.approx(goals, abs=1e-6)
    assert np.linalg.norm(end - root) < MAX_EXTENSION * length + 1e-9


def test_a_goal_out_of_reach_is_pointed_at() -> None:
    goal = np.array([[0.0, -2.0, 0.0]])
    _, end = two_bone_ik(np.zeros((1, 3)), goal, (0.3, 0.3), np.array([[0.0, 0.0, 1.0]]))
    assert end == pytest.approx(np.array([[0.0, -MAX_EXTENSION * 0.6, 0.0]]), abs=1e-6)
