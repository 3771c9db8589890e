"""Truth: Wilson's published example values; the two-by-two table; answers of a known model."""

import numpy as np
import pytest
from scipy.special import expit, logit

from pacmo_core.metrics.survey import fit_mixed, share


@pytest.mark.parametrize(
    ("count", "of", "low", "high"),
    # Newcombe (1998), Statistics in Medicine 17, table I, method 3.
    [
        (81, 263, 0.2553, 0.3662),
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0.0, 0.1611),
        (1, 29, 0.0061, 0.1718),
    ],
)
def test_intervals_are_wilsons(count: int, of: int, low: float, high: float) -> None:
    found = share(count, of)
    assert found.mean == count / of
    assert (found.low, found.high) == pytest.approx((low, high), abs=5e-5)


def test_a_share_of_nothing_is_refused() -> None:
    for count, of in ((0, 0), (3, 2), (-1, 2)):
        with pytest.raises(ValueError, match="wanted 0 <= count"):
            share(count, of)


def test_without_leanings_the_difference_is_the_tables() -> None:
    # Everybody says the same share of real, of every clip: no person and no clip leans.
    people, clips, captured, real = [], [], [], []
    for person in range(20):
        for clip in range(10):
            people.append(person)
            clips.append(clip)
            captured.append(clip < 5)
            real.append((person + clip) % 5 < (4 if clip < 5 else 2))
    found = fit_mixed(people, clips, captured, real)
    assert found.difference == pytest.approx(logit(0.8) - logit(0.4), abs=0.02)
    assert max(found.person_spread, found.clip_spread) < 0.05
    half = 1.96 * np.sqrt(1 / 80 + 1 / 20 + 1 / 40 + 1 / 60)
    assert (found.high - found.low) / 2 == pytest.approx(half, rel=0.02)


@pytest.mark.slow
def test_the_mixed_model_is_recovered_from_many_answers() -> None:
    random = np.random.default_rng(3)
    people, clips = (x.ravel() for x in np.meshgrid(np.arange(80), np.arange(40)))
    captured = clips < 20
    leaning = random.normal(0, 1.0, 80)[people] + random.normal(0, 0.6, 40)[clips]
    real = random.random(len(people)) < expit(0.5 + 0.8 * captured + leaning)
    found = fit_mixed(people.tolist(), clips.tolist(), captured.tolist(), real.tolist())
    assert found.low < 0.8 < found.high
    assert found.person_spread == pytest.approx(1.0, abs=0.25)
    assert found.clip_spread == pytest.approx(0.6, abs=0.25)
    # Two sets of 20 clips that lean by 0.6 differ by chance alone, which a table does not see.
    assert (found.high - found.low) / 2 > 1.96 * 0.6 * np.sqrt(2 / 20) * 0.75


def test_answers_that_are_all_alike_have_a_finite_model() -> None:
    found = fit_mixed([0, 0, 1, 1], [0, 1, 0, 1], [True, False] * 2, [True] * 4)
    assert np.isfinite([found.difference, found.low, found.high]).all()
    assert found.low < 0 < found.high
    with pytest.raises(ValueError, match="captured and to generated"):
        fit_mixed([0], [0], [True], [True])
