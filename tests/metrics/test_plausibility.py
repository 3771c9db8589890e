"""Trusted: bodies placed by hand, and the joints that the published skeletons name."""

from dataclasses import replace

import numpy as np
import pytest

from pacmo_core.data.skeleton import DUET15, EXPI18, INTERHUMAN22, NTU25, SBU15, Skeleton
from pacmo_core.metrics.evaluate import Evaluation
from pacmo_core.metrics.plausibility import (
    contact_agreement,
    find_body_joints,
    foot_skate,
    penetration,
)
from pacmo_core.metrics.row_metrics import measure_multimodality, measure_plausibility
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


def test_without_names_every_joint_is_a_key_and_no_foot_slides():
    skeleton = Skeleton("chain", ("a", "b", "c"), (-1, 0, 1))
    body = find_body_joints(skeleton)
    assert body.keys == (0, 1, 2) and body.feet == ()
    rng = np.random.default_rng(3)
    real, train = reactions(5, "test", rng), reactions(9, "train", rng)
    settings = replace(SETTINGS, body=body)
    table = Evaluation(real=real, train=train, weights=WEIGHTS, settings=settings)
    found, reasons = measure_plausibility(real, table.context)
    assert reasons == {"foot_skate": "the skeleton names no feet"}
    assert set(found) == {"penetration", "contact_agreement"}


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


def test_a_foot_on_the_ground_slides_at_its_speed_and_a_lifted_one_does_not():
    real, sliding = standing_row(1.0, 0.0), standing_row(1.0, 0.6)
    above, below = foot_skate(sliding, real, BODY, height=0.05)
    np.testing.assert_allclose(above / below, 0.6, rtol=1e-4)
    np.testing.assert_array_equal(below, 10)
    lifted = replace(sliding, motions=[m + np.float32([0, 0.1, 0]) for m in sliding.motions])
    np.testing.assert_array_equal(foot_skate(lifted, real, BODY, height=0.05), 0)


def test_bodies_merge_where_the_middle_of_a_bone_is_within_the_radius():
    row = standing_row(0.1, 0.0)
    # The reaction's joints stand between the partner's: its joints meet the middles of bones.
    shifted = [m + np.float32([0, 0.25, 0]) for m in row.motions]
    row = replace(row, motions=shifted)
    merged, frames = penetration(row, BODY, radius=0.11)
    np.testing.assert_array_equal(merged, frames)
    np.testing.assert_array_equal(penetration(row, BODY, radius=0.09)[0], 0)


def test_contact_agrees_by_frame():
    real, leaving = standing_row(0.1, 0.0), standing_row(0.1, 0.9)  # 3 cm a frame
    above, below = contact_agreement(leaving, real, distance=0.17)
    # In contact: 0.10, 0.13, 0.16 m, against all 11 frames.
    np.testing.assert_array_equal(above, 6)
    np.testing.assert_array_equal(below, 14)


def test_multimodality_is_the_mean_distance_of_the_features_of_one_partners_reactions():
    rng = np.random.default_rng(5)
    real, train = reactions(5, "test", rng, further=2), reactions(9, "train", rng)
    table = Evaluation(real=real, train=train, weights=WEIGHTS, settings=SETTINGS)
    found, _ = measure_multimodality(real, table.context)
    sets = [real.features, *real.further]
    pairs = [(0, 1), (0, 2), (1, 2)]
    gaps = [np.sqrt((WEIGHTS * (sets[i] - sets[j]) ** 2).sum(axis=(1, 2))) for i, j in pairs]
    assert found["multimodality"].plain == pytest.approx(np.mean(gaps))
