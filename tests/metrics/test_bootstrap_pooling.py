"""Trusted: means worked out by hand, and the variance of a mean of seeds."""

import numpy as np
import pytest

from pacmo_core.metrics.bootstrap import Estimate, Interval, pool_folds, pooled_interval
from pacmo_core.metrics.controls import EXACT_FOR_REAL, sensitivity


def constant(value, n=400):
    return Estimate(value, np.full(n, value))


def test_the_value_is_the_mean_over_folds_of_the_mean_over_seeds():
    folds = [{1: constant(1.0), 2: constant(3.0)}, {1: constant(5.0), 2: constant(9.0)}]
    found = pool_folds(folds, 0)
    assert found.plain == pytest.approx(4.5)
    # Within a fold two seeds drawn of two: their mean is 1, 2, 2 or 3; 5, 7, 7 or 9.
    assert set(found.resampled) <= {3.0, 3.5, 4.0, 4.5, 5.0, 5.5, 6.0}
    assert found.resampled.mean() == pytest.approx(4.5, abs=0.15)
    assert found.resampled.var() == pytest.approx((0.5 + 2.0) / 4, rel=0.2)


def test_one_seed_keeps_its_draws_and_folds_average_draw_by_draw():
    rng = np.random.default_rng(0)
    one, two = (Estimate(0.0, rng.normal(size=50)) for _ in range(2))
    np.testing.assert_allclose(pool_folds([{1: one}], 3).resampled, one.resampled)
    both = pool_folds([{1: one}, {1: two}], 3).resampled
    np.testing.assert_allclose(both, (one.resampled + two.resampled) / 2)


def test_two_rows_draw_the_same_seeds():
    first = [{1: constant(1.0), 2: constant(2.0), 3: constant(6.0)}]
    second = [{seed: constant(e.plain + 0.5) for seed, e in first[0].items()}]
    gap = pool_folds(second, 1).minus(pool_folds(first, 1))
    np.testing.assert_allclose(gap.resampled, 0.5)


def test_repeats_of_the_papers_protocol_are_pooled_by_mean_and_extremes():
    folds = [{1: Estimate(2.0, np.array([1.0, 3.0]))}, {1: Estimate(5.0, np.array([4.0, 6.0]))}]
    found = pooled_interval("f2id_published", folds, 0, 0.95)
    assert found == Interval(3.5, 1.0, 6.0)


def test_a_metric_that_cannot_be_negative_is_cut_at_zero():
    folds = [{1: Estimate(0.1, np.linspace(-1, 1, 100))}]
    assert pooled_interval("ape", folds, 0, 0.9).low == 0
    assert pooled_interval("f2id_excess", folds, 0, 0.9).low < 0


def test_a_share_is_cut_at_one_and_a_distance_is_not():
    folds = [{1: Estimate(0.9, np.linspace(0, 1, 100))}]
    assert pooled_interval("contacts_met.kick", folds, 0, 0.9).high == 1
    assert pooled_interval("ape", folds, 0, 0.9).high > 1


def test_what_has_not_one_number_of_draws_is_refused():
    with pytest.raises(ValueError, match="one number of replicates"):
        pool_folds([{1: constant(1.0, 5)}, {1: constant(1.0, 6)}], 0)
    with pytest.raises(ValueError, match="every fold"):
        pool_folds([{1: constant(1.0)}, {}], 0)


def test_a_metric_sees_when_the_difference_is_clear_of_zero_on_the_good_side():
    noise = np.random.default_rng(1).normal(size=300)
    true = {
        "matching": Estimate(0.6, 0.6 + 0.02 * noise),
        "mmd_pair": Estimate(0.3, 0.3 + 0.02 * noise),
        "mmd_s": constant(0.0, 300),
        "diversity": constant(2.0, 300),
        "ape": constant(0.0, 300),
        "multimodality": constant(1.0, 300),
    }
    permuted = {
        "matching": constant(0.1, 300),
        "mmd_pair": constant(0.1, 300),  # clear of zero, on the bad side
        "mmd_s": Estimate(0.0, 0.01 * noise),
        "diversity": constant(1.5, 300),
        "ape": constant(1.0, 300),
        "multimodality": constant(1.0, 300),
    }
    found = sensitivity(true, permuted, 0.95, left_out=EXACT_FOR_REAL)
    sees = {name: seen.sensitive for name, seen in found.items()}
    assert sees == {"matching": True, "mmd_pair": False, "mmd_s": False, "diversity": True}
    assert found["matching"].mean == pytest.approx(0.5)
    assert found["matching"].low == pytest.approx(0.5 - 0.02 * 1.96, abs=0.01)


def test_mmd_of_reactions_alone_never_sees_the_partner() -> None:
    draws = np.linspace(1.0, 1.1, 50)
    true, permuted = (
        {name: Estimate(value, value * draws) for name in ("mmd_a", "mmd_pair")}
        for value in (1.0, 2.0)
    )
    found = sensitivity(true, permuted, 0.95)
    assert found["mmd_pair"].sensitive
    assert not found["mmd_a"].sensitive  # better for certain, and yet by no merit
