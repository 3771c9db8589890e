"""Trusted: quantiles of given replicates, and a known distribution sampled often."""

import numpy as np
import pytest

from pacmo_core.data.splits import ClipOrigin
from pacmo_core.metrics.bootstrap import (
    CLIP,
    PAIR,
    RECORDING,
    Estimate,
    Interval,
    bootstrap_units,
    difference,
    interval,
    interval_of_repeats,
    resampling_unit,
    unit_name,
)
from pacmo_core.metrics.f2id import weighted_f2id
from pacmo_core.metrics.mmd import pair_means


def test_the_bounds_are_the_mirrored_quantiles_of_draws_moved_to_the_plain_value():
    draws = np.array([10.0, 11, 12, 13, 19])  # mean 13, quantiles at 0 and 1: 10 and 19
    found = interval(Estimate(5.0, draws), 1 - 1e-12)
    assert (found.mean, found.low, found.high) == pytest.approx((5.0, 5 - 6, 5 + 3))
    assert interval(Estimate(5.0, draws), 1 - 1e-12, minimum=0.0).low == 0.0


def test_a_difference_is_taken_draw_by_draw():
    noise = np.random.default_rng(0).normal(size=300)
    first, second = Estimate(1.0, 1 + noise), Estimate(0.5, 0.5 + noise)
    found = difference(first, second, 0.95)
    np.testing.assert_allclose([found.mean, found.low, found.high], 0.5, atol=1e-12)
    with pytest.raises(ValueError, match="300 and 2"):
        difference(first, Estimate(0.0, noise[:2]), 0.95)


@pytest.mark.parametrize("confidence", [0.0, 1.0, 95.0])
def test_confidence_must_be_a_share(confidence):
    with pytest.raises(ValueError, match="confidence"):
        interval(Estimate(0.0, np.zeros(3)), confidence)


def test_repeats_are_reported_by_mean_and_extremes():
    assert interval_of_repeats(np.array([1.0, 4.0, 1.0])) == Interval(2.0, 1.0, 4.0)


def test_units_are_drawn_once_for_all_sets_and_leave_none_with_too_few():
    sets = np.array([[1, 1, 0, 0, 0, 0, 0, 0], [0, 0, 2, 2, 2, 2, 2, 2]])
    counts = bootstrap_units(sets, 500, np.random.default_rng(0), least_units=2, least_clips=3)
    np.testing.assert_array_equal(counts.sum(axis=1), 8)
    assert ((counts > 0).astype(int) @ (sets > 0).T >= 2).all()
    assert (counts @ sets.T >= 3).all()
    free = bootstrap_units(np.ones((1, 8), dtype=int), 4000, np.random.default_rng(0))
    np.testing.assert_allclose(free.mean(axis=0), 1, atol=0.1)
    # Of a multinomial distribution with 8 trials.
    np.testing.assert_allclose(free.var(axis=0), 7 / 8, atol=0.1)


@pytest.mark.parametrize("n_units", [1, 2, 3])
def test_few_units_are_not_resampled(n_units):
    with pytest.raises(ValueError, match=f"needs 4 units, and 2 in each set; got {n_units}"):
        bootstrap_units(np.ones((1, n_units), dtype=int), 5, np.random.default_rng(0))


def test_a_set_of_one_unit_is_not_resampled():
    with pytest.raises(ValueError, match="and 1 in a set"):
        bootstrap_units(np.eye(1, 9, dtype=int), 5, np.random.default_rng(0))
    with pytest.raises(ValueError, match="wanted 5 clips in each replicate; a set has at most 4"):
        bootstrap_units(np.ones((1, 4), dtype=int), 5, np.random.default_rng(0), least_clips=5)


def test_an_estimate_without_replicates_has_no_interval():
    found = interval(Estimate(2.0, np.zeros(0)), 0.95, minimum=0.0)
    assert found.mean == 2 and np.isnan([found.low, found.high]).all()


def test_the_unit_is_the_pair_of_people_and_the_recording_where_there_are_none_or_one():
    def clips(*people, prefix):
        return [ClipOrigin(f"{prefix}{i}", f"{prefix}{i // 2}", p) for i, p in enumerate(people)]

    two = [("s1", "s2"), ("s1", "s2"), ("s2", "s3"), ("s2", "s3")]
    test, train = clips(*two, prefix="x"), clips(*two, prefix="y")
    assert resampling_unit(test, train) == PAIR
    assert unit_name(ClipOrigin("x", "r", ("s2", "s1")), PAIR) == "s1+s2"
    assert resampling_unit(clips(*two[:2], *two[:2], prefix="x"), train) == RECORDING
    assert resampling_unit(test, clips((), (), (), (), prefix="y")) == RECORDING
    assert resampling_unit(clips(*two[:2], prefix="x"), train) == CLIP


def test_pair_means_are_those_of_a_loop_over_pairs_of_different_clips():
    rng = np.random.default_rng(1)
    values, rows, columns = (
        rng.normal(size=(5, 4)),
        rng.integers(4, size=5),
        rng.integers(4, size=4),
    )
    counts = np.array([[1.0, 1, 1, 1], [2, 0, 1, 1]])
    for found, count in zip(pair_means(values, rows, columns, counts), counts, strict=True):
        total = weight = 0.0
        for i in range(5):
            for j in range(4):
                if rows[i] != columns[j]:
                    total += count[rows[i]] * count[columns[j]] * values[i, j]
                    weight += count[rows[i]] * count[columns[j]]
        assert found == pytest.approx(total / weight)


def test_the_bootstrap_of_a_pair_mean_is_not_biased():
    rng = np.random.default_rng(2)
    values, clips = rng.exponential(size=(40, 40)), np.arange(40) // 2
    counts = bootstrap_units(np.ones((1, 20), dtype=np.intp), 4000, rng)
    draws = pair_means(values + values.T, clips, clips, counts)
    plain = pair_means(values + values.T, clips, clips, np.ones((1, 20)))[0]
    assert draws.mean() == pytest.approx(plain, abs=4 * draws.std() / np.sqrt(4000))


def two_per_clip(n_clips, rng):
    common = np.repeat(rng.normal(size=(n_clips, 3)), 2, axis=0)
    return common + rng.normal(size=(2 * n_clips, 3))


@pytest.mark.parametrize("paired", [True, False])
def test_intervals_of_f2id_hold_its_mean_at_that_number_of_clips_about_as_often_as_stated(paired):
    n_clips, rng = 20, np.random.default_rng(3)
    once, clips = np.ones(2 * n_clips), np.repeat(np.arange(n_clips), 2)

    def draw():
        x = two_per_clip(n_clips, rng)
        noise = rng.normal(size=x.shape)
        return (x, 1.5 * x + 0.3 + 0.5 * noise) if paired else (x, two_per_clip(n_clips, rng))

    target = np.mean([weighted_f2id(*draw(), once, once) for _ in range(1000)])
    held = []
    for _ in range(60):
        x, y = draw()
        one = np.ones((1, n_clips), dtype=np.intp)
        counts = np.concatenate([bootstrap_units(one, 100, rng) for _ in range(2)], axis=1)
        others = clips if paired else clips + n_clips
        draws = np.array([weighted_f2id(x, y, c[clips], c[others]) for c in counts])
        found = interval(Estimate(weighted_f2id(x, y, once, once), draws), 0.9)
        held.append(found.low <= target <= found.high)
    assert np.mean(held) >= 0.78  # 0.9 stated; 60 trials have a standard error of 0.04
