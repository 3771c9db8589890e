"""What is trusted: pairs placed by hand, whose errors can be told without measuring."""

import numpy as np
import pytest

from pacmo_core.data.skeleton import DUET15
from pacmo_core.metrics.plausibility import find_body_joints
from pacmo_core.metrics.retargeting import (
    RetargetingLimits,
    bone_error,
    contacts_preserved,
    energy_score,
    foot_skate,
    frechet_distance,
    joint_error,
    pair_distance_error,
    penetrating_frames,
    precision_and_coverage,
    sample_diversity,
)

LIMITS = RetargetingLimits(
    contact_distance=0.1, contact_slack=0.02, foot_height=0.05, body_radius=0.05
)
RANDOM = np.random.default_rng(0)


def pair(n_frames=6, apart=1.0):
    """Place one random still body twice, ``apart`` metres along x."""
    body = np.random.default_rng(1).normal(size=(15, 3))
    both = np.stack([body, body + np.array([apart, 0, 0])])
    return np.repeat(both[None], n_frames, axis=0).astype(np.float32)


def test_a_shift_of_one_character_is_his_error_alone():
    truth = pair()
    moved = truth.copy()
    moved[:, 1] += np.float32([0.3, 0, 0.4])
    np.testing.assert_allclose(joint_error(moved, truth), [0, 0.5], atol=1e-6)
    lengths = np.ones((2, 14))
    np.testing.assert_allclose(bone_error(moved, truth, lengths, DUET15), 0, atol=1e-6)


def test_the_bone_error_is_the_mean_of_what_bones_lack():
    template = pair()
    scales = np.ones((2, 14))
    scales[0, 3] = 1.5
    parent, child = DUET15.bones[3]
    bone = np.linalg.norm(template[0, 0, child] - template[0, 0, parent])
    found = bone_error(template, template, scales, DUET15)
    np.testing.assert_allclose(found, [0.5 * bone / 14, 0], atol=1e-6)


def test_distances_between_bodies_do_not_mind_where_both_stand():
    truth = pair()
    assert pair_distance_error(truth + np.float32(2), truth) == pytest.approx(0, abs=1e-6)
    moved = truth.copy()
    moved[:, 1] += np.float32([0.1, 0, 0])
    slow = np.mean(
        [
            abs(
                np.linalg.norm(moved[0, 0, i] - moved[0, 1, j])
                - np.linalg.norm(truth[0, 0, i] - truth[0, 1, j])
            )
            for i in range(15)
            for j in range(15)
        ]
    )
    assert pair_distance_error(moved, truth) == pytest.approx(slow, rel=1e-5)


def test_contacts_are_kept_up_to_the_slack():
    template = pair(apart=0.0)  # each joint on its twin
    kept, touching = contacts_preserved(template, template, LIMITS)
    assert kept == touching >= 6 * 15
    apart = template.copy()
    apart[:3, 1] += 10
    kept, again = contacts_preserved(apart, template, LIMITS)
    assert (kept, again) == (touching / 2, touching)


def test_feet_that_stand_in_the_template_slide_at_their_speed():
    body, template = find_body_joints(DUET15), pair()
    times = np.arange(6) / 10
    moving = template + np.arange(6, dtype=np.float32)[:, None, None, None] * [0.02, 0, 0]
    total, count = foot_skate(moving.astype(np.float32), template, times, body, LIMITS)
    assert count == 2 * 2 * 5  # two feet of two people in five steps
    assert total / count == pytest.approx(0.2, rel=1e-4)
    rising = template.copy()
    rising[3, :, :, 1] += 1  # off the ground in one frame: two steps
    assert foot_skate(moving.astype(np.float32), rising, times, body, LIMITS)[1] == 2 * 2 * 3


def test_bodies_merge_where_points_meet():
    body = find_body_joints(DUET15)
    together = np.concatenate([pair(2, 0.0), pair(3, 50.0)])
    assert penetrating_frames(together, body, LIMITS) == 2


def test_diversity_is_the_mean_over_pairs_of_samples():
    one = pair()
    assert sample_diversity(one[None]) == 0
    samples = np.stack([one, one + np.float32([0, 0.2, 0]), one + np.float32([0, 0.6, 0])])
    assert sample_diversity(samples) == pytest.approx((0.2 + 0.6 + 0.4) / 3, rel=1e-5)


def test_the_frechet_distance_of_shifted_features_is_the_squared_shift():
    features = RANDOM.normal(size=(200, 5))
    assert frechet_distance(features, features) == pytest.approx(0, abs=1e-9)
    assert frechet_distance(features, features + np.array([3, 0, 4, 0, 0])) == pytest.approx(
        25, rel=1e-9
    )


def test_pairs_of_other_shapes_are_refused():
    with pytest.raises(ValueError, match=r"wanted pairs \(T, 2, J, 3\) of one shape"):
        joint_error(pair(), pair(5))


def test_the_energy_score_is_the_error_less_half_the_spread():
    truth = pair()
    shifts = np.float32([0.2, 0.4])[:, None, None, None, None] * np.float32([1, 0, 0])
    samples = truth[None] + shifts
    assert energy_score(samples, truth) == pytest.approx(0.3 - 0.2 / 2, rel=1e-5)
    assert energy_score(samples[:1], truth) == pytest.approx(0.2, rel=1e-5)


def test_precision_and_coverage_of_points_on_a_line():
    real = np.arange(10.0)[:, None]
    assert precision_and_coverage(real, real, k=1) == (1.0, 1.0)
    assert precision_and_coverage(np.repeat(real, 7, axis=0), real, k=1) == (1.0, 1.0)
    near_two = np.array([[2.5], [50.0], [60.0], [70.0]])
    assert precision_and_coverage(real, near_two, k=1) == (0.25, 0.2)
