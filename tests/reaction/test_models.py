"""Truth: that a seed fixes every byte, and toy laws that the models must come to know."""

import itertools
import json
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch

from pacmo_core.data.skeleton import NTU25
from pacmo_core.reaction import autoencoder, baselines, generator, wgan
from pacmo_core.reaction.data import expand_directions, sample_motion_pairs
from pacmo_core.reaction.settings import AdamSettings
from pacmo_core.reaction.wgan import WganTrainer
from pacmo_core.training.loop import TrainingLoop
from pacmo_core.training.state import model_config, model_state
from pacmo_core.training.supervised import random_batches
from tests.reaction.problems import AUTOENCODER, GRU, PACMO, PACMO_LONG, REGRESSION, clips

FITS: dict[str, Callable[[], TrainingLoop[torch.nn.Module]]] = {
    "autoencoder": lambda: autoencoder.build_training(clips(8), replace(AUTOENCODER, n_epochs=2)),
    "gru": lambda: baselines.build_gru_training(clips(8), replace(GRU, n_epochs=2)),
    "pacmo": lambda: wgan.build_training(clips(8), PACMO),
    "regression": lambda: baselines.build_regression_training(
        clips(8), replace(REGRESSION, n_epochs=2)
    ),
    "labelled": lambda: wgan.build_training(
        clips(8), replace(PACMO, action_channels=2), actions=["push", "hug"] * 4
    ),
}
READERS: dict[str, Callable[..., torch.nn.Module]] = {
    "autoencoder": autoencoder.autoencoder_from_state,
    "gru": baselines.gru_from_state,
    "pacmo": generator.generator_from_state,
    "regression": generator.generator_from_state,
    "labelled": generator.generator_from_state,
}


@pytest.mark.parametrize("name", FITS)
def test_one_seed_gives_one_model_bit_for_bit(name: str) -> None:
    first, second = (model_state(FITS[name]().finish()) for _ in range(2))
    assert all(torch.equal(first[key], second[key]) for key in first)


@pytest.mark.parametrize("name", FITS)
def test_a_model_comes_back_from_its_state_and_json(name: str) -> None:
    model = FITS[name]().finish()
    config = json.loads(json.dumps(model_config(model)))
    again = READERS[name](config, model_state(model))
    assert again.config == model.config
    assert all(torch.equal(a, model_state(again)[key]) for key, a in model_state(model).items())


def test_looking_at_held_out_clips_does_not_change_the_training() -> None:
    plain = model_state(FITS["pacmo"]().finish())
    watched = wgan.build_training(clips(8), PACMO, validation=clips(3, first_seed=90))
    looked = ["validation" in terms for terms in itertools.islice(watched, PACMO.n_epochs)]
    assert looked == [False, True, False, True]
    # The last weights, before the best take their place.
    assert all(torch.equal(plain[key], value) for key, value in model_state(watched.model).items())


def test_batches_hold_every_row_once() -> None:
    cut = random_batches(21, 8, torch.Generator().manual_seed(0))
    assert sorted(torch.cat(cut).tolist()) == list(range(21))
    assert {len(rows) for rows in cut} == {7}


def test_the_papers_baseline_has_its_published_size() -> None:
    skeleton = NTU25.without(["left_hand_tip", "left_thumb", "right_hand_tip", "right_thumb"])
    model = baselines.Gru(baselines.GruConfig(skeleton, fps=30.0, hidden=200, n_layers=5))
    assert sum(p.numel() for p in model.parameters()) == 1_216_863


def test_clips_of_different_lengths_do_not_change_each_other_in_the_baseline() -> None:
    model = FITS["gru"]().finish()
    frames = baselines.sample_frames(clips(4), 15.0, "cpu")
    together = model.loss(frames, range(4)).item()
    lengths = np.array([len(motion) for motion in frames.partner])
    alone = np.array([model.loss(frames, [i]).item() for i in range(4)])
    assert together == pytest.approx((alone * lengths).sum() / lengths.sum(), rel=1e-5)


@pytest.mark.slow
def test_the_autoencoder_learns_and_its_features_are_standard_on_training_data() -> None:
    fitted = autoencoder.build_training(clips(32), AUTOENCODER, validation=clips(8, first_seed=50))
    terms = list(fitted)
    assert terms[-1]["validation"] < 0.4 * terms[0]["validation"]
    found = autoencoder.encode_features(fitted.model, expand_directions(clips(32), both=True))
    assert found.shape == (64, 4, 5)
    np.testing.assert_allclose(found.mean(axis=(0, 2)), 0, atol=1e-5)
    np.testing.assert_allclose(found.std(axis=(0, 2)), 1, atol=1e-2)


@pytest.mark.slow
def test_the_baseline_learns() -> None:
    held_out = baselines.sample_frames(clips(8, first_seed=50), GRU.fps, "cpu")
    # From the leading side: the frames seen so far don't tell what the leader will do.
    fitted = baselines.build_gru_training(clips(32), replace(GRU, both_directions=False))
    errors = [fitted.model.loss(held_out, range(8)).item() for _ in fitted]
    assert errors[-1] < 0.4 * errors[0]


@pytest.mark.slow
def test_the_generator_learns_to_follow_its_partner() -> None:
    model = wgan.build_training(clips(64), PACMO_LONG).finish()
    pairs = sample_motion_pairs(clips(32, first_seed=100), PACMO.n_points)
    with torch.no_grad():
        noise = model.sample_noise(len(pairs), torch.Generator().manual_seed(0))
        made = model(noise, pairs.condition)
    moving = pairs.reaction.std(dim=(0, 1)) > 0.01
    error = (made - pairs.reaction)[..., moving].square().mean()
    of_the_mean = (model.normalisation.reaction_mean - pairs.reaction)[..., moving].square().mean()
    assert error < 0.5 * of_the_mean


def test_a_learning_rate_that_explodes_is_refused_by_name() -> None:
    broken = replace(PACMO, generator=AdamSettings(1e12, (0.0, 0.9)), n_epochs=20)
    with pytest.raises(FloatingPointError, match="not finite"):
        wgan.build_training(clips(8), broken).finish()


def test_in_the_warm_up_the_critic_rests_and_no_weights_are_chosen() -> None:
    fitted = wgan.build_training(
        clips(8), replace(PACMO, warmup_epochs=2, validate_from=3), validation=clips(3, 90)
    )
    training = fitted.trainer
    assert isinstance(training, WganTrainer)
    critic, generator = (
        {name: value.clone() for name, value in model_state(network).items()}
        for network in (training.critic, training.generator)
    )
    curve = iter(fitted)
    warm = [next(curve), next(curve)]
    assert all(terms.keys() == {"bone_symmetry", "energy_score"} for terms in warm)
    assert all(
        torch.equal(critic[name], value) for name, value in model_state(training.critic).items()
    )
    assert not torch.equal(generator["uno.lift.weight"], training.generator.uno.lift.weight)
    terms = list(curve)
    assert {"wasserstein_distance", "critic_score", "energy_score", "validation"} <= terms[
        -1
    ].keys()
    assert not torch.equal(critic["uno.lift.weight"], training.critic.uno.lift.weight)


def test_a_warm_up_without_an_energy_score_is_refused() -> None:
    with pytest.raises(ValueError, match=r"warmup_epochs 1, energy_score_weight 0\.0"):
        replace(PACMO, warmup_epochs=1, energy_score_weight=0.0)
    with pytest.raises(ValueError, match="got warmup_epochs 4, validate_from 1"):
        replace(PACMO, warmup_epochs=4)


def test_fewer_epochs_than_selection_starts_at_are_refused_with_both_values() -> None:
    with pytest.raises(ValueError, match="got validate_from 90, n_epochs 5"):
        replace(PACMO, validate_from=90, n_epochs=5)
    with pytest.raises(ValueError, match="n_epochs must be at least 1; got 0"):
        replace(GRU, n_epochs=0)


@pytest.mark.slow
def test_the_regressed_trunk_learns_to_follow_its_partner() -> None:
    fitted = baselines.build_regression_training(
        clips(32), REGRESSION, validation=clips(8, first_seed=50)
    )
    curve = list(fitted)
    assert curve[-1]["validation"] < 0.4 * curve[0]["loss"]
