"""Truth: products of turns about single axes."""

from itertools import permutations

import numpy as np
import pytest

from pacmo_core.formats.rotations import (
    axis_rotations,
    continuous_euler_angles,
    euler_angles_near,
)
from pacmo_core.formats.write_bvh import zxy_angles


def product(order: tuple[int, ...], degrees: np.ndarray) -> np.ndarray:
    turns = [axis_rotations(axis, degrees[:, column]) for column, axis in enumerate(order)]
    return turns[0] @ turns[1] @ turns[2]


@pytest.mark.parametrize("order", list(permutations(range(3))))
def test_angles_in_any_order_of_axes_give_the_rotation_back(order: tuple[int, ...]) -> None:
    random = np.random.default_rng(0)
    degrees = random.uniform([-180, -90, -180], [180, 90, 180], (40, 3))
    degrees[:2, 1] = 90, -90  # where the outer two turns are one
    rotations = product(order, degrees)
    found = euler_angles_near(rotations, order, degrees)
    np.testing.assert_allclose(product(order, found), rotations, atol=1e-12)
    apart = np.abs((found - degrees + 180) % 360 - 180)[2:]
    np.testing.assert_allclose(apart, 0, atol=1e-9)


@pytest.mark.parametrize("axis", range(3))
def test_a_turn_leaves_its_axis_and_takes_the_next_towards_the_one_after(axis: int) -> None:
    (turn,) = axis_rotations(axis, np.array([90.0]))
    unit = np.eye(3)
    np.testing.assert_allclose(turn @ unit[axis], unit[axis], atol=1e-15)
    np.testing.assert_allclose(turn @ unit[(axis + 1) % 3], unit[(axis + 2) % 3], atol=1e-15)


def test_angles_go_on_past_a_half_turn() -> None:
    degrees = np.stack([np.linspace(0, 700, 80), np.zeros(80), np.zeros(80)], axis=1)
    found = euler_angles_near(product((2, 0, 1), degrees), (2, 0, 1), degrees)
    np.testing.assert_allclose(found, degrees, atol=1e-9)


def test_they_are_those_that_other_bvh_files_are_written_with() -> None:
    random = np.random.default_rng(1)
    rotations = product((2, 0, 1), random.uniform(-80, 80, (20, 3)))
    expected = zxy_angles(rotations)
    found = euler_angles_near(rotations, (2, 0, 1), expected)
    np.testing.assert_allclose(found, expected, atol=1e-9)


@pytest.mark.parametrize("order", list(permutations(range(3))))
def test_of_all_angles_those_nearest_to_others_are_found(order: tuple[int, ...]) -> None:
    random = np.random.default_rng(2)
    degrees = random.uniform(-700, 700, (60, 3))
    found = euler_angles_near(
        product(order, degrees), order, degrees + random.normal(0, 3, (60, 3))
    )
    np.testing.assert_allclose(found, degrees, atol=1e-6)


@pytest.mark.parametrize("order", list(permutations(range(3))))
def test_angles_of_a_motion_do_not_jump(order: tuple[int, ...]) -> None:
    # Through a right angle of the middle axis, where the other of the two triples is the nearer.
    t = np.linspace(0, 1, 200)
    degrees = np.stack([300 * t, 40 + 110 * t, -250 * t], axis=1)
    found = continuous_euler_angles(product(order, degrees), order, degrees)
    np.testing.assert_allclose(found, degrees, atol=1e-6)
    near_first = continuous_euler_angles(product(order, degrees), order, 0 * degrees + degrees[0])
    np.testing.assert_allclose(near_first, degrees, atol=1e-6)
