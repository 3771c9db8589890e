"""Truth: reactions that follow their partner; warm-up and validation leave the rest unchanged."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
import torch

from pacmo_core.reaction import wgan
from pacmo_core.reaction.data import sample_motion_pairs
from pacmo_core.reaction.settings import AdamSettings
from pacmo_core.reaction.wgan import WganTrainer
from pacmo_core.training.state import model_state
from tests.reaction.problems import GRU, PACMO, PACMO_LONG, clips


def test_validation_does_not_change_the_training() -> None:
    plain = model_state(wgan.build_training(clips(8), PACMO).finish())
    watched = wgan.build_training(clips(8), PACMO, validation=clips(3, first_seed=90))
    looked = ["validation" in terms for terms in itertools.islice(watched, PACMO.n_epochs)]
    assert looked == [False, True, False, True]
    # The last weights, before the best take their place.
    assert all(torch.equal(plain[key], value) for key, value in model_state(watched.model).items())


def test_parts_of_clips_are_shown_beside_them_and_not_in_validation() -> None:
    parts = replace(PACMO.parts, n=2)
    plain, more = (
        wgan.build_training(clips(8), replace(PACMO, parts=of), validation=clips(4)).trainer
        for of in (PACMO.parts, parts)
    )
    assert len(more.pairs) == 3 * len(plain.pairs)
    assert more.steps_per_epoch > plain.steps_per_epoch
    torch.testing.assert_close(more.pairs.partner[:8], plain.pairs.partner[:8])
    shorter = more.pairs.log_duration[8:24] - plain.pairs.log_duration[:8].repeat(2)
    assert (shorter.exp() < 0.95).all()
    assert more.validation_pairs is not None
    assert len(more.validation_pairs) == 8


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


def test_in_the_warm_up_the_critic_is_not_trained_and_no_weights_are_selected() -> None:
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
    names = {"bone_symmetry", "energy_score", "contact_score"}
    assert all(terms.keys() == names for terms in warm)
    assert all(
        torch.equal(critic[name], value) for name, value in model_state(training.critic).items()
    )
    assert not torch.equal(generator["uno.lift.weight"], training.generator.uno.lift.weight)
    terms = list(curve)
    assert {"wasserstein_distance", "critic_score", "energy_score", "validation"} <= terms[
        -1
    ].keys()
    assert not torch.equal(critic["uno.lift.weight"], training.critic.uno.lift.weight)


def test_the_generators_rate_falls_to_nothing_in_the_last_epochs() -> None:
    settings = replace(
        PACMO, n_epochs=6, halve_learning_rate_every=2, cooldown_epochs=3, validate_from=5
    )
    training = wgan.build_training(clips(4), settings).trainer
    assert isinstance(training, WganTrainer)
    rates, critics = [], []
    for number in range(settings.n_epochs):
        training.train_epoch(number)
        rates.append(training.adam_generator.param_groups[0]["lr"])
        critics.append(training.adam_critic.param_groups[0]["lr"])
    full = 2e-3 * np.array([1, 1, 0.5, 0.5, 0.25, 0.25])
    assert rates == pytest.approx(full * [1, 1, 1, 3 / 4, 2 / 4, 1 / 4])
    assert critics == pytest.approx(full)
    for epochs in (-1, 7):
        with pytest.raises(ValueError, match=f"got cooldown_epochs {epochs}, n_epochs 6"):
            replace(settings, cooldown_epochs=epochs)


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


def test_without_a_critic_the_generator_takes_as_many_steps_and_the_critic_none() -> None:
    fitted = wgan.build_training(clips(8), replace(PACMO, n_critic=0))
    one_each = wgan.build_training(clips(8), replace(PACMO, n_critic=1))
    training, other = fitted.trainer, one_each.trainer
    assert isinstance(training, WganTrainer) and isinstance(other, WganTrainer)
    assert training.steps_per_epoch == other.steps_per_epoch
    critic = {name: value.clone() for name, value in model_state(training.critic).items()}
    for terms in fitted:
        assert terms.keys() >= {"bone_symmetry", "energy_score"}
        assert not terms.keys() & {"distance", "penalty", "gradient_norm"}
    assert all(
        torch.equal(critic[name], value) for name, value in model_state(training.critic).items()
    )
    with pytest.raises(ValueError, match="n_critic must be .* energy_score_weight 0"):
        replace(PACMO, n_critic=0, warmup_epochs=0, energy_score_weight=0.0)


def test_the_temperature_with_the_best_validation_score_is_set() -> None:
    watched = clips(4, first_seed=90)

    def validated(*temperatures: float) -> tuple[float, float, float]:
        settings = replace(PACMO, temperatures=list(temperatures), validate_from=0, warmup_epochs=0)
        trainer = wgan.build_training(clips(8), settings, validation=watched).trainer
        trainer.train_epoch(0)
        score = float(trainer.validate()["validation"])
        return score, float(trainer.model.temperature), float(trainer.generator.temperature)

    alone = {value: validated(value)[0] for value in (0.25, 1.0, 4.0)}
    assert len(set(alone.values())) == 3
    best = min(alone, key=alone.__getitem__)
    assert validated(*alone) == (alone[best], best, 1.0)


def test_noise_has_the_models_temperature_as_its_standard_deviation() -> None:
    model = wgan.build_training(clips(4), replace(PACMO, temperatures=[1.5])).model
    noise = model.sample_noise(2000, torch.Generator().manual_seed(0))
    values = model.config.noise.evaluate(noise, torch.tensor([0.3]))
    assert float(values.std()) == pytest.approx(1.5, rel=0.05)


def test_a_temperature_of_zero_is_refused() -> None:
    with pytest.raises(ValueError, match=r"above 0; got \[1.0, 0.0\]"):
        replace(PACMO, temperatures=[1.0, 0.0])
