"""Trusted: the published mean and spread of stature; a subject's number alone makes the body."""

import numpy as np
import pytest
from scipy import stats

from pacmo_core.synthesis.body import SHARES, sample_pair, sample_subject


# ANSUR II, centimetres.
@pytest.mark.parametrize(
    ("sex", "mean", "spread"), [("female", 162.85, 6.42), ("male", 175.62, 6.86)]
)
def test_statures_have_the_surveys_distribution(sex: str, mean: float, spread: float) -> None:
    everyone = (sample_subject(1, number) for number in range(1, 4000))
    statures = np.array([100 * who.body.stature for who in everyone if who.sex == sex])
    assert len(statures) > 1850
    error = spread / np.sqrt(len(statures))
    assert statures.mean() == pytest.approx(mean, abs=3 * error)
    assert statures.std() == pytest.approx(spread, abs=3 * error / np.sqrt(2))
    assert stats.kstest(statures, "norm", (mean, spread)).pvalue > 0.01


def test_segments_are_near_their_share_of_stature() -> None:
    bodies = [sample_subject(1, k).body for k in range(1, 800)]
    for name, share in SHARES.items():
        shares = np.array([getattr(body, name) / body.stature for body in bodies])
        assert shares.mean() == pytest.approx(share, rel=0.004)
        assert 0.015 < shares.std() / share < 0.03


def test_a_subject_is_the_same_however_many_are_drawn() -> None:
    sample_subject.cache_clear()
    alone = sample_subject(3, 9)
    sample_subject.cache_clear()
    assert [sample_subject(3, k) for k in range(1, 12)][8] == alone
    assert sample_pair(3, 5) == (alone, sample_subject(3, 10))


def test_another_population_has_other_people() -> None:
    assert sample_subject(3, 9).body != sample_subject(4, 9).body


@pytest.mark.parametrize(("population", "number"), [(-1, 1), (0, 0)])
def test_a_subject_without_a_number_is_refused(population: int, number: int) -> None:
    with pytest.raises(ValueError, match=f"got {population}, {number}"):
        sample_subject(population, number)
