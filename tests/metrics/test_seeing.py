"""Trusted: laws in which the partner is all that matters, and bodies placed by hand."""

from dataclasses import replace

import numpy as np
import pytest

from pacmo_core.metrics.body import body_of
from pacmo_core.metrics.closeness import components_of, distance_functions
from pacmo_core.metrics.mmd import median_bandwidth
from pacmo_core.metrics.pair_kernels import PairMmd
from pacmo_core.metrics.partners import wrong_partners
from pacmo_core.metrics.plausibility import contact_agreement, foot_sliding, penetration
from pacmo_core.metrics.seeing import measure_multimodality, measure_plausibility
from pacmo_core.metrics.table import Table
from pacmo_core.metrics.yardstick import Yardstick
from pacmo_core.skeleton import DUET15, EXPI18, INTERHUMAN22, NTU25, SBU15, Skeleton
from tests.metrics.problems import reactions
from tests.metrics.test_table import BODY, SETTINGS, WEIGHTS


def following(n_clips, prefix, rng):
    """Partners at random places; a reaction stands half a metre off, whatever its partner does."""
    row = reactions(n_clips, prefix, rng, further=1)
    partners = [2 * rng.normal(size=(1, 1, 3)) + 0.1 * m for m in row.motions]
    motions = [p + np.array([0.5, 0, 0]) + 0.05 * rng.normal(size=p.shape) for p in partners]
    as_float = [[m.astype(np.float32) for m in some] for some in (partners, motions)]
    return replace(row, partners=as_float[0], motions=as_float[1])


def dealt(row, rng):
    """Deal reactions of one length, so that none is stretched."""
    chosen = wrong_partners(row.clips, None, rng)
    other = row.take(chosen)
    motions = [
        m[: len(p)] if len(m) >= len(p) else np.resize(m, p.shape)
        for m, p in zip(other.motions, row.partners, strict=True)
    ]
    return replace(row, motions=motions, embedded=np.stack([row.embedded[0], other.embedded[1]]))


def test_true_pairs_score_better_than_dealt_ones_where_the_partner_is_all_that_matters():
    rng = np.random.default_rng(0)
    real, train = following(20, "test", rng), following(40, "train", rng)
    table = Table(real=real, train=train, weights=WEIGHTS, settings=SETTINGS)
    true, other = (table.measure(row).estimates for row in (real, dealt(real, rng)))
    for name in ("f2id_distances", "mmd_pair"):
        gap = other[name].minus(true[name])
        assert gap.plain > 0 and gap.resampled.min() > 0, name
    assert (true["matching"].minus(other["matching"])).resampled.min() > 0


def test_distances_between_bodies_do_not_change_when_both_move_together():
    rng = np.random.default_rng(1)
    row = following(4, "c", rng)
    moved = replace(
        row,
        motions=[(m + 3).astype(np.float32) for m in row.motions],
        partners=[(p + 3).astype(np.float32) for p in row.partners],
    )
    before, after = (distance_functions(r, BODY, 5) for r in (row, moved))
    assert before.shape == (8, 9, 5)
    np.testing.assert_allclose(before, after, atol=1e-4)
    expected = np.linalg.norm(row.partners[2][0, 1] - row.motions[2][0, 2])
    assert before[2, 1 * 3 + 2, 0] == pytest.approx(expected, rel=1e-6)


def test_all_components_keep_every_distance_and_few_keep_the_largest():
    functions = np.random.default_rng(2).normal(size=(30, 2, 4)) * [[[1.0], [50.0]]]
    full, few = (components_of(functions, k) for k in (8, 3))
    standard = (functions - full.mean) / full.scale
    expected = np.linalg.norm((standard[0] - standard[1]).ravel()) / 2  # √(mean over 4 instants)
    gap = np.subtract(*full.coordinates(functions)[:2])
    assert np.linalg.norm(gap) == pytest.approx(expected)
    assert few.axes.shape == (8, 3)
    np.testing.assert_allclose(np.abs(few.axes.T @ full.axes[:, :3]), np.eye(3), atol=1e-9)


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
    body = body_of(skeleton)
    assert {skeleton.joints[i] for i in body.feet} == feet
    assert len(body.keys) == n_keys and body.root in body.keys


def test_without_names_every_joint_is_a_key_and_no_foot_slides():
    skeleton = Skeleton("chain", ("a", "b", "c"), (-1, 0, 1))
    body = body_of(skeleton)
    assert body.keys == (0, 1, 2) and body.feet == ()
    rng = np.random.default_rng(3)
    real, train = reactions(5, "test", rng), reactions(9, "train", rng)
    settings = replace(SETTINGS, body=body)
    table = Table(real=real, train=train, weights=WEIGHTS, settings=settings)
    found, reasons = measure_plausibility(real, table.yardstick)
    assert reasons == {"foot_sliding": "the skeleton names no feet"}
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
    above, below = foot_sliding(sliding, real, BODY, height=0.05)
    np.testing.assert_allclose(above / below, 0.6, rtol=1e-4)
    np.testing.assert_array_equal(below, 10)
    lifted = replace(sliding, motions=[m + np.float32([0, 0.1, 0]) for m in sliding.motions])
    np.testing.assert_array_equal(foot_sliding(lifted, real, BODY, height=0.05), 0)


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
    table = Table(real=real, train=train, weights=WEIGHTS, settings=SETTINGS)
    found, _ = measure_multimodality(real, table.yardstick)
    sets = [real.features, *real.further]
    pairs = [(0, 1), (0, 2), (1, 2)]
    gaps = [np.sqrt((WEIGHTS * (sets[i] - sets[j]) ** 2).sum(axis=(1, 2))) for i, j in pairs]
    assert found["multimodality"].plain == pytest.approx(np.mean(gaps))


@pytest.mark.parametrize("groups", [np.zeros(16, dtype=int), np.repeat([0, 1], 8)])
def test_mmd_of_dealt_pairs_is_the_mean_over_partners_and_reactions_of_each_group(groups):
    rng = np.random.default_rng(6)
    real, train = following(8, "test", rng), following(12, "train", rng)
    yardstick = Yardstick(real=real, train=train, weights=WEIGHTS, settings=SETTINGS)
    partners, motions = (
        yardstick.sequences(some, real.times)[:, 0] for some in (real.partners, real.motions)
    )
    widths = [
        median_bandwidth(yardstick.sequences(some, train.times))
        for some in (train.partners, train.motions)
    ]

    def kernel(x, y, width):
        return np.exp(-((x[:, None] - y) ** 2).sum(axis=-1) / width)

    kernels = [kernel(x, x, w) for x, w in zip((partners, motions), widths, strict=True)]
    codes, shares = yardstick.partners, np.bincount(groups) / 16
    within = sum(
        shares[a]
        * shares[b]
        * np.prod(
            [
                np.mean(
                    [
                        k[i, j]
                        for i in np.flatnonzero(groups == a)
                        for j in np.flatnonzero(groups == b)
                        if codes[i] != codes[j]
                    ]
                )
                for k in kernels
            ]
        )
        for a in range(len(shares))
        for b in range(len(shares))
    )
    expected = []
    for second in yardstick.seconds:
        others = [
            yardstick.sequences(some, second.times)[:, 0]
            for some in (second.partners, second.motions)
        ]
        own = np.prod([kernel(x, x, w) for x, w in zip(others, widths, strict=True)], axis=0)
        clips = np.unique(second.clips, return_inverse=True)[1]
        between = [
            kernel(x, y, w) for x, y, w in zip((partners, motions), others, widths, strict=True)
        ]
        crossed = sum(
            share * np.mean(np.prod([b[groups == a].mean(axis=0) for b in between], axis=0))
            for a, share in enumerate(shares)
        )
        expected.append(within + own[clips[:, None] != clips].mean() - 2 * crossed)
    found = PairMmd(yardstick).dealt(real, groups)
    assert found[0] == pytest.approx(np.mean(expected), rel=1e-6)
    assert found.shape == (41,) and np.isfinite(found).all()
