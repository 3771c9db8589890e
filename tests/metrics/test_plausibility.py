"""Trusted: bodies placed by hand, and the joints that the published skeletons name."""

from dataclasses import replace

import numpy as np
import pytest

from pacmo_core.data.skeleton import DUET15, EXPI18, INTERHUMAN22, NTU25, SBU15, Skeleton
from pacmo_core.metrics.evaluate import Evaluation
from pacmo_core.metrics.plausibility import (
    bone_variation,
    find_body_joints,
    foot_skate,
    ground_penetration,
    jerk,
    jolts,
    lurches,
    peak_acceleration,
    smooth,
    step_length,
)
from pacmo_core.metrics.row_plausibility import measure_multimodality, measure_plausibility
from tests.metrics.problems import reactions
from tests.metrics.test_evaluate_table import BODY, SETTINGS, WEIGHTS


@pytest.mark.parametrize(
    ("skeleton", "feet", "n_keys"),
    [
        (NTU25, {"left_foot", "right_foot"}, 8),
        (SBU15, {"left_foot", "right_foot"}, 6),
        (DUET15, {"left_ankle", "right_ankle"}, 6),
        (EXPI18, {"left_toe", "right_toe"}, 6),
        (INTERHUMAN22, {"left_foot", "right_foot"}, 6),
    ],
)
def test_feet_hands_and_head_are_found_in_every_published_skeleton(skeleton, feet, n_keys):
    body = find_body_joints(skeleton)
    assert {skeleton.joints[i] for i in body.feet} == feet
    assert len(body.keys) == n_keys and body.root in body.keys


def test_a_thing_that_is_held_is_no_bone_of_the_body():
    joints, parents = (*SBU15.joints, "object"), (*SBU15.parents, SBU15.root)
    held = Skeleton("held", joints, parents, SBU15.left_right)
    np.testing.assert_array_equal(find_body_joints(held).bones, find_body_joints(SBU15).bones)


def test_without_names_every_joint_is_a_key_and_no_foot_slides():
    skeleton = Skeleton("chain", ("a", "b", "c"), (-1, 0, 1))
    body = find_body_joints(skeleton)
    assert body.keys == (0, 1, 2) and body.feet == ()
    rng = np.random.default_rng(3)
    real, train = reactions(5, "test", rng), reactions(9, "train", rng)
    settings = replace(SETTINGS, body=body)
    table = Evaluation(real=real, train=train, weights=WEIGHTS, settings=settings)
    found, reasons = measure_plausibility(real, table.context)
    no_feet = "the skeleton names no feet"
    no_arms = "the skeleton names no arms"
    without_feet = ("foot_skate", "step_length", "ground_penetration")
    assert reasons == {**dict.fromkeys(without_feet, no_feet), "lurches": no_arms}
    assert set(found) == {"penetration", "bone_variation", "jerk", "jolts"}


def standing(offset, drift, n=11):
    """Two clips alike: a body of three joints that drifts along x, its foot on the ground."""
    motion = np.zeros((n, 3, 3), dtype=np.float32)
    motion[:, :, 1] = [1.0, 0.5, 0.0]
    motion[:, :, 0] = offset + drift * np.arange(n)[:, None] / 30
    return motion


def standing_row(offset, drift):
    row = reactions(2, "c", np.random.default_rng(4))
    return replace(
        row,
        motions=[standing(offset, drift)] * 4,
        partners=[standing(0.0, 0.0)] * 4,
        times=[np.arange(11) / 30] * 4,
    )


def ratio(sums):
    numerator, denominator = sums
    return numerator.sum() / denominator.sum()


def test_the_slower_ankle_glides_at_its_speed():
    body = replace(BODY, ankles=(0, 2))
    sliding = standing_row(1.0, 0.6)
    # A Gaussian keeps a straight path, but at the ends, where it is one-sided.
    assert ratio(foot_skate(sliding, body, smoothing=1e-3)) == pytest.approx(0.6, rel=1e-4)
    walking = [m.copy() for m in sliding.motions]
    for motion in walking:
        motion[:, 2, 0] = 1.0
    resting = ratio(foot_skate(replace(sliding, motions=walking), body, smoothing=0.1))
    assert resting == pytest.approx(0, abs=1e-9)


def test_smoothing_removes_the_noise_of_a_resting_foot_and_keeps_a_constant():
    times = np.arange(200) / 30
    noise = 0.01 * np.random.default_rng(0).normal(size=(200, 2)).astype(np.float32)
    np.testing.assert_allclose(smooth(np.full((200, 2), 3.0), times, 0.1), 3.0, rtol=1e-12)
    # The sum of squared weights of a Gaussian of 3 frames is 1 / (2 sqrt(pi) 3).
    expected = 0.01 * np.sqrt(1 / (2 * np.sqrt(np.pi) * 3))
    assert smooth(noise, times, 0.1)[20:-20].std() == pytest.approx(expected, rel=0.2)


def test_a_joint_below_the_ground_of_the_real_reaction_is_as_deep_as_it_is_lowered():
    real = standing_row(1.0, 0.0)
    lowered = replace(real, motions=[m - np.float32([0, 0.03, 0]) for m in real.motions])
    assert ratio(ground_penetration(lowered, real, BODY)) == pytest.approx(0.03, rel=1e-5)
    lifted = replace(real, motions=[m + np.float32([0, 0.03, 0]) for m in real.motions])
    assert ratio(ground_penetration(lifted, real, BODY)) == 0


def test_a_bone_that_stretches_varies_by_its_standard_deviation():
    row = standing_row(1.0, 0.0)
    assert ratio(bone_variation(row, BODY)) == 0
    path = row.motions[0].copy()
    path[:, 0, 1] += np.where(np.arange(11) % 2, 0.1, 0.0)  # of two bones of 0.5 m, the first
    lengths = 0.5 + np.where(np.arange(11) % 2, 0.1, 0.0)
    expected = lengths.std() / lengths.mean() / 2
    assert ratio(bone_variation(replace(row, motions=[path] * 4), BODY)) == pytest.approx(
        expected, rel=1e-5
    )


def test_the_jerk_of_a_cubic_path_is_its_third_derivative():
    row = standing_row(1.0, 0.0)
    times = np.arange(61) / 60
    path = np.zeros((61, 3, 3), dtype=np.float32)
    path[:, :, 1] = times[:, None] ** 3
    long = replace(row, motions=[path] * 4, partners=[path] * 4, times=[times] * 4)
    numerator, denominator = jerk(long, smoothing=1e-4)
    assert ratio((numerator, denominator)) == pytest.approx(6, rel=0.01)


def test_the_peak_acceleration_of_a_parabola_is_its_second_derivative_at_any_times():
    times = np.sort(np.random.default_rng(6).uniform(0, 1, 40))
    path = np.zeros((40, 3, 3))
    path[:, 1, 0] = 1.5 * times**2
    assert peak_acceleration(path, times) == pytest.approx(3.0, rel=1e-6)
    assert peak_acceleration(path[:2], times[:2]) == 0


def test_one_joint_that_jumps_in_one_frame_is_a_jolt_and_real_motion_has_none():
    real = standing_row(1.0, 0.3)
    shaken = [m + np.float32(1e-3) * (np.arange(11) % 2)[:, None, None] for m in real.motions]
    real = replace(real, motions=[m.astype(np.float32) for m in shaken])
    assert ratio(jolts(real, real)) == 0
    motions = [m.copy() for m in real.motions]
    motions[2][5:, 1, 0] += 0.1
    assert ratio(jolts(replace(real, motions=motions), real)) == 1 / 4


def test_step_length_is_how_far_the_ankles_are_apart_along_the_way_of_a_walk():
    times = np.arange(121) / 30
    swing = np.sin(2 * np.pi * times)
    body = replace(BODY, ankles=(0, 2))
    walk = np.zeros((121, 3, 3), dtype=np.float32)
    walk[:, 0, 2], walk[:, 2, 2] = 0.2 * swing, -0.2 * swing
    walk[:, 0, 0] = 0.3  # to the side of the way, which does not count
    stands, shuffles = walk.copy(), walk.copy()
    shuffles[:, [0, 2], 2] *= 0.5
    for motion in (walk, shuffles):
        motion[:, :, 2] += 1.2 * times[:, None]
    row = replace(
        standing_row(1.0, 0.0),
        motions=[walk, shuffles, stands, stands],
        partners=[walk] * 4,
        times=[times] * 4,
    )
    along, frames = step_length(row, body, smoothing=0.01)
    np.testing.assert_allclose(along[:2] / frames[:2], [0.8 / np.pi, 0.4 / np.pi], rtol=0.02)
    assert not frames[2:].any()


def test_a_trunk_that_folds_and_a_pelvis_that_sinks_for_an_instant_lurch():
    times = np.arange(31) / 30
    still = np.zeros((31, 3, 3), dtype=np.float32)
    still[:, 0, 1] = 0.5  # the shoulders, above the root, which is joint 1
    rng = np.random.default_rng(5)
    noisy = [(still + 0.002 * rng.normal(size=still.shape)).astype(np.float32) for _ in range(4)]
    base = standing_row(1.0, 0.0)
    real = replace(base, motions=noisy, partners=[still] * 4, times=[times] * 4)
    bump = np.exp(-0.5 * ((times - 0.5) / 0.06) ** 2).astype(np.float32)
    folds, sinks, walks = still.copy(), still.copy(), still.copy()
    folds[:, 0, 2] += 0.15 * bump
    sinks[:, :, 1] -= 0.1 * bump[:, None]
    walks[:, :, 2] += 2 * times[:, None]
    row = replace(real, motions=[folds, sinks, walks, still])
    found = lurches(row, real, BODY, smoothing=0.05)
    np.testing.assert_array_equal(found, [[1, 1, 0, 0], [1, 1, 1, 1]])
    short = replace(
        row, motions=[m[:8] for m in row.motions], partners=[still[:8]] * 4, times=[times[:8]] * 4
    )
    assert ratio(lurches(short, real, BODY, smoothing=0.05)) == 0


def test_multimodality_is_the_mean_distance_of_the_features_of_one_partners_reactions():
    rng = np.random.default_rng(5)
    real, train = reactions(5, "test", rng, further=2), reactions(9, "train", rng)
    table = Evaluation(real=real, train=train, weights=WEIGHTS, settings=SETTINGS)
    found, _ = measure_multimodality(real, table.context)
    sets = [real.features, *real.further]
    pairs = [(0, 1), (0, 2), (1, 2)]
    gaps = [np.sqrt((WEIGHTS * (sets[i] - sets[j]) ** 2).sum(axis=(1, 2))) for i, j in pairs]
    assert found["multimodality"].plain == pytest.approx(np.mean(gaps))
