"""Trusted: bodies placed by hand, distances that are known in every frame."""

import numpy as np
import pytest

from pacmo_core.metrics.contact import (
    bone_distance,
    contact_distances,
    contact_f1,
    contacts_met,
    false_contacts,
    nearest_in_time,
    penetration,
)
from tests.metrics.test_evaluate_table import BODY
from tests.metrics.test_plausibility import standing_row

CAPTURED = [np.array([0.05, 0.08, 0.20, 0.30, 0.40])]


def test_the_distance_is_that_of_the_nearest_joints():
    for distances in contact_distances(standing_row(0.1, 0.9)):  # 3 cm a frame
        np.testing.assert_allclose(distances, 0.1 + 0.03 * np.arange(11), atol=1e-6)


def test_contacts_met_are_those_of_captured_contact_in_which_the_generated_are_near():
    generated = [np.array([0.14, 0.16, 0.01, 0.01, 0.5])]
    met = contacts_met(generated, CAPTURED, contact=0.1, met=0.15)
    np.testing.assert_array_equal(met, [[1], [2]])


def test_false_contacts_are_those_where_the_captured_are_far_apart():
    generated = [np.array([0.01, 0.01, 0.01, 0.14, 0.16])]
    false = false_contacts(generated, CAPTURED, apart=0.25, met=0.15)
    np.testing.assert_array_equal(false, [[1], [2]])


def test_f1_counts_the_frames_of_contact_of_either():
    generated = [np.array([0.05, 0.20, 0.05, 0.05, 0.5])]
    np.testing.assert_array_equal(contact_f1(generated, CAPTURED, distance=0.1), [[2], [5]])


def test_a_contact_may_be_a_tenth_of_a_second_late():
    times = np.arange(6) / 30
    distances = np.array([1.0, 1, 1, 1, 0, 1])
    np.testing.assert_array_equal(nearest_in_time(distances, times), [1, 0, 0, 0, 0, 0])


def test_capsules_penetrate_where_bones_are_nearer_than_two_radii():
    row = standing_row(0.07, 0.0)
    total, frames = penetration(row, BODY, radius=0.05)
    assert total.sum() / frames.sum() == pytest.approx(0.03, rel=1e-5)
    np.testing.assert_array_equal(penetration(row, BODY, radius=0.03)[0], 0)


def test_bones_cross_nearer_than_any_of_their_ends():
    bones = np.array([[0, 1]])
    one = np.float32([[[-1, 0, 0], [1, 0, 0]]])
    other = np.float32([[[0, 0.2, -1], [0, 0.2, 1]]])
    assert bone_distance(one, other, bones) == pytest.approx([0.2])
