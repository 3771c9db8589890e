"""What is trusted: SciPy's paired t test, and sums done by hand."""

import numpy as np
import pytest
from scipy.stats import ttest_1samp

from pacmo_core.metrics.bootstrap import Estimate, fold_differences, fold_mean_interval


def runs(**values: float) -> dict[int, Estimate]:
    return {int(seed[1:]): Estimate(value, np.zeros(3)) for seed, value in values.items()}


def test_a_folds_difference_is_the_mean_over_the_seeds_that_both_have():
    first = [runs(s1=1.0, s2=3.0, s3=9.0), runs(s1=5.0)]
    second = [runs(s1=0.5, s2=1.0), runs(s1=6.0)]
    np.testing.assert_allclose(fold_differences(first, second), [1.25, -1.0])


def test_the_interval_over_folds_is_that_of_the_t_test():
    values = np.array([0.1, -0.4, 0.3, 0.8, 0.2])
    found = fold_mean_interval(values, 0.9)
    wanted = ttest_1samp(values, 0.0).confidence_interval(0.9)
    assert (found.mean, found.low, found.high) == pytest.approx((0.2, wanted.low, wanted.high))


def test_one_fold_has_no_interval():
    assert fold_mean_interval(np.array([0.3]), 0.95) is None


def test_what_cannot_be_paired_is_refused():
    with pytest.raises(ValueError, match=r"seed in common, got \[1\] and \[2\]"):
        fold_differences([runs(s1=1.0)], [runs(s2=1.0)])
    with pytest.raises(ValueError, match="shorter"):
        fold_differences([runs(s1=1.0)] * 2, [runs(s1=1.0)])
