"""What a body's steps are held against: closed forms."""

import numpy as np

from pacmo_core.interaction_mesh.ladder import SHARED, asked_of


def test_a_body_of_one_bone_is_asked_what_that_grows() -> None:
    grown = np.zeros((1, 9))
    grown[0, 4] = 0.3
    np.testing.assert_allclose(asked_of(grown), [0.3])


def test_of_equal_bones_each_asks_the_less_the_more_they_are() -> None:
    np.testing.assert_allclose(asked_of(np.full((2, 7), 0.2)), 1.4 / 7**SHARED)


def test_the_unit_of_length_makes_no_difference() -> None:
    grown = np.random.default_rng(0).uniform(size=(3, 5))
    np.testing.assert_allclose(asked_of(100 * grown), 100 * asked_of(grown))
