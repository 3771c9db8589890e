"""Truth: laws of one number, whose energy scores are integrals, and the definition written out."""

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from pacmo_core.data.skeleton import SBU15
from pacmo_core.operators.quadrature import trapezoid_weights
from pacmo_core.reaction.energy_score import EnergyScore, energy_score
from tests.reaction.problems import REST

WEIGHTS = trapezoid_weights(torch.linspace(0, 1, 5))


def constant(values: torch.Tensor) -> torch.Tensor:
    """Functions of time that do not change, of norm |value|."""
    return values[..., None, None].expand(*values.shape, 5, 1)


@settings(derandomize=True, deadline=None, max_examples=20)
@given(st.integers(2, 6), st.integers(0, 1000))
def test_it_is_its_definition_written_out(n_samples, seed):
    random = torch.Generator().manual_seed(seed)
    samples = torch.randn(n_samples, 2, 5, 3, generator=random)
    truth = torch.randn(2, 5, 3, generator=random)

    def norm(a):
        return math.sqrt(sum(float(w) * float(a[t].square().mean()) for t, w in enumerate(WEIGHTS)))

    for row, found in enumerate(energy_score(samples, truth, WEIGHTS)):
        errors = [norm(s[row] - truth[row]) for s in samples]
        apart = [
            norm(samples[k, row] - samples[other, row])
            for k in range(n_samples)
            for other in range(k + 1, n_samples)
        ]
        expected = sum(errors) / n_samples - sum(apart) / (n_samples * (n_samples - 1))
        assert float(found) == pytest.approx(expected, rel=1e-4, abs=1e-5)


def test_samples_of_the_true_distribution_score_what_the_closed_form_says():
    # E|X - u| = 2 / sqrt(pi) for two standard normals; less half of it.
    random = torch.Generator().manual_seed(0)
    samples, truth = (torch.randn(n, 20000, generator=random) for n in (4, 1))
    found = energy_score(constant(samples), constant(truth[0]), WEIGHTS).mean()
    assert float(found) == pytest.approx(1 / math.sqrt(math.pi), abs=0.02)


@pytest.mark.parametrize("spread", [0.0, 0.5, 2.0])
def test_the_true_distribution_scores_better_than_one_too_narrow_or_too_wide(spread):
    random = torch.Generator().manual_seed(1)
    samples, truth = (torch.randn(n, 20000, generator=random) for n in (4, 1))
    right, wrong = (
        energy_score(constant(scale * samples), constant(truth[0]), WEIGHTS).mean()
        for scale in (1.0, spread)
    )
    assert right < wrong


def test_the_right_partners_score_better_than_others():
    random = torch.Generator().manual_seed(2)
    partner = torch.randn(5000, generator=random)
    samples = partner + 0.5 * torch.randn(4, 5000, generator=random)
    truth = constant(partner + 0.5 * torch.randn(5000, generator=random))
    right = energy_score(constant(samples), truth, WEIGHTS).mean()
    assert right < 0.6 * energy_score(constant(samples.roll(1, dims=1)), truth, WEIGHTS).mean()


def test_one_sample_is_refused():
    with pytest.raises(ValueError, match="at least 2 samples; got 1"):
        energy_score(torch.zeros(1, 2, 5, 1), torch.zeros(2, 5, 1), WEIGHTS)


def test_the_score_of_a_motion_is_the_mean_of_its_views():
    # One joint of fifteen is off by d, in one sample; the truth and the other sample stand still.
    d = 0.3
    truth = torch.from_numpy(REST).float().flatten().expand(1, 5, 45)
    off = truth.clone()
    off[..., 5 * 3 + 1] += d  # a hand: a leaf, so one bone changes, and its place in the pose
    samples = torch.stack([off, truth])
    # |X - u| averages d' / 2 over the samples, less half of |X - X'| = d': nothing but round-off.
    assert float(EnergyScore(SBU15)(samples, truth, WEIGHTS)) == pytest.approx(0, abs=1e-3)
    both = EnergyScore(SBU15)(torch.stack([off, off]), truth, WEIGHTS)
    # Whole motion and pose: d / sqrt(45); bones: 2 d / sqrt(42); path and speed do not change.
    expected = (2 * d / 45**0.5 + 2 * d / 42**0.5) / 5
    assert float(both) == pytest.approx(expected, rel=2e-3)


def test_a_motion_that_shivers_scores_worse_though_it_is_as_near():
    steady = torch.zeros(2, 1, 5, 45)
    shivering = steady.clone()
    steady += 0.1
    shivering += 0.1 * torch.tensor([1.0, -1.0, 1.0, -1.0, 1.0])[:, None]
    score = EnergyScore(SBU15)
    truth = torch.zeros(1, 5, 45)
    assert float(score(shivering, truth, WEIGHTS)) > 1.2 * float(score(steady, truth, WEIGHTS))
