"""Truth: weights that add up to one; the distribution of the noise; equivariance of reactions."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from pacmo_core.data.interaction import Motion
from pacmo_core.operators.random_field import GaussianRandomField
from pacmo_core.reaction import wgan
from pacmo_core.reaction.generator import Generator
from pacmo_core.reaction.inference import react, react_all
from pacmo_core.reaction.inputs import Normalisation
from pacmo_core.reaction.windows import (
    NOISE_INTERVAL,
    ContinuousNoise,
    PartnerMotion,
    split_into_windows,
    window_weights,
)
from tests.reaction.problems import PACMO_LONG, clips, delayed_mirror

FIELD = GaussianRandomField(alpha=2.0, tau=5.0, n_frequencies=8, period=1.25)


@pytest.fixture(scope="module")
def model() -> Generator:
    return wgan.build_training(clips(8), replace(PACMO_LONG, n_epochs=2)).finish()


def trained_on(seconds: float, spread: float = 0.1) -> Normalisation:
    normalisation = Normalisation(channels=3)
    normalisation.log_duration.copy_(torch.tensor([math.log(seconds), spread]))
    return normalisation


def sway(n_frames: int) -> tuple[Motion, np.ndarray]:
    clip = delayed_mirror(3, np.arange(n_frames) / 15)
    return clip.person_a, clip.times


@settings(derandomize=True, deadline=None)
@given(st.floats(-1e4, 1e4), st.floats(0.5, 400), st.floats(0.5, 8))
def test_windows_cover_a_sequence_and_their_weights_add_up_to_one(
    start: float, duration: float, usual: float
) -> None:
    windows = split_into_windows(start, start + duration, trained_on(usual))
    times = np.linspace(start, start + duration, 501)
    total = np.zeros(501)
    for rows, weights in window_weights(windows, times):
        assert (weights >= 0).all()
        total[rows] += weights
    np.testing.assert_allclose(total, 1)
    lengths = [window.duration for window in windows]
    assert len(windows) == 1 or lengths == pytest.approx([usual] * len(windows))
    assert windows[0].start == start and windows[-1].end == pytest.approx(start + duration)


def test_a_sequence_as_long_as_training_clips_is_taken_whole() -> None:
    assert len(split_into_windows(0, 4.5, trained_on(4))) == 1
    assert len(split_into_windows(0, 6.0, trained_on(4))) == 2


def test_weights_change_little_from_frame_to_frame() -> None:
    times = np.linspace(0, 60, 1801)
    for rows, weights in window_weights(split_into_windows(0, 60, trained_on(4)), times):
        assert np.abs(np.diff(weights)).max() < 0.05
        assert rows.start == 0 or weights[0] < 0.01


def test_a_shifted_field_is_the_field_at_later_instants() -> None:
    coefficients = FIELD.sample(3, 2, random=torch.Generator().manual_seed(0))
    times = torch.linspace(0, 1, 11)
    torch.testing.assert_close(
        FIELD.evaluate(FIELD.shift(coefficients, 0.37), times),
        FIELD.evaluate(coefficients, times + 0.37),
        atol=1e-5,
        rtol=1e-4,
    )


def test_noise_has_one_distribution_in_every_window_and_is_one_function_where_they_overlap() -> (
    None
):
    n = 20_000
    random = torch.Generator().manual_seed(0)
    noise = ContinuousNoise(FIELD, lambda: FIELD.sample(n, random=random))
    starts = [0.0, 0.02, 0.5, 1.0, 1.7, NOISE_INTERVAL, 2.6, 7.3]
    found = [noise.coefficients(start) for start in starts]
    expected = FIELD.power().float().repeat_interleave(2)
    for coefficients in found:
        # A variance of n normals has the relative standard error sqrt(2 / n); five of them.
        spread = coefficients.var(dim=0) / expected
        assert (spread - 1).abs().max() < 5 * math.sqrt(2 / n)
    soon = FIELD.shift(found[1], -0.02) - found[0]
    assert soon.square().sum() < 1e-4 * found[0].square().sum()
    half = FIELD.shift(found[2], -0.5) - found[0]
    assert half.square().sum() < 0.1 * found[0].square().sum()
    late = FIELD.shift(found[-1], -7.3)
    correlation = (late * found[0]).sum() / found[0].square().sum()
    assert abs(correlation) < 0.05


def test_a_long_reaction_is_smooth_across_windows_and_linear_in_its_parts(
    model: Generator,
) -> None:
    motion, times = sway(300)
    at = np.linspace(0, times[-1], 1201)
    random = torch.Generator().manual_seed(0)
    (reaction,) = react(model, motion, times, out_times=at, n_samples=1, random=random)
    assert np.isfinite(reaction).all()
    speed = np.linalg.norm(np.diff(reaction, axis=0), axis=-1).max(axis=-1)
    assert speed.max() < 12 * np.median(speed)


def test_long_and_short_partners_in_one_batch_react_as_if_alone(model: Generator) -> None:
    partners = [PartnerMotion(*sway(n), sway(n)[1]) for n in (300, 20, 90)]
    together = react_all(model, partners, n_samples=3, random=torch.Generator().manual_seed(0))
    random = torch.Generator().manual_seed(0)
    for partner, motion in zip(partners, together, strict=True):
        (alone,) = react_all(model, [partner], n_samples=3, random=random)
        np.testing.assert_allclose(motion, alone, atol=1e-5)


def test_a_sample_is_the_same_however_many_there_are(model: Generator) -> None:
    motion, times = sway(300)
    few, many = (
        react(
            model,
            motion,
            times,
            out_times=times,
            n_samples=n_samples,
            random=torch.Generator().manual_seed(5),
        )
        for n_samples in (1, 4)
    )
    np.testing.assert_allclose(many[:1], few, atol=1e-5)
    assert np.abs(many[1] - few[0]).max() > 1e-3


def test_rates_mixed_in_one_batch_do_not_change_each_other(model: Generator) -> None:
    motion, times = sway(25)
    rates = [np.linspace(0, times[-1], n) for n in (25, 200, 7)]
    partners = [PartnerMotion(motion, times, rate) for rate in rates]
    together = react_all(model, partners, n_samples=1, random=torch.Generator().manual_seed(0))
    random = torch.Generator().manual_seed(0)
    for partner, found in zip(partners, together, strict=True):
        (alone,) = react_all(model, [partner], n_samples=1, random=random)
        np.testing.assert_allclose(found, alone, atol=1e-5)


def test_many_instants_go_through_in_blocks_that_do_not_show(
    model: Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    motion, times = sway(25)

    def reaction() -> Motion:
        random = torch.Generator().manual_seed(0)
        return react(model, motion, times, out_times=times, n_samples=2, random=random)

    whole = reaction()
    monkeypatch.setattr("pacmo_core.reaction.inference.MAX_TIMES_PER_BATCH", 7)
    np.testing.assert_allclose(reaction(), whole, atol=1e-5)


def test_instants_that_do_not_ascend_are_refused(model: Generator) -> None:
    motion, times = sway(25)
    random = torch.Generator()
    with pytest.raises(ValueError, match="ascend"):
        react(model, motion, times, out_times=times[::-1], n_samples=1, random=random)


def test_a_few_instants_of_a_long_reaction_are_those_of_the_whole(model: Generator) -> None:
    motion, times = sway(300)

    def reaction(at: np.ndarray) -> Motion:
        random = torch.Generator().manual_seed(0)
        return react(model, motion, times, out_times=at, n_samples=1, random=random)

    whole = reaction(times)
    for rows in (slice(0, 3), slice(150, 151), slice(290, 300)):
        np.testing.assert_allclose(reaction(times[rows]), whole[:, rows], atol=1e-5)
