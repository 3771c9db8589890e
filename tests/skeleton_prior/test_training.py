"""Oracle: trainings with the same seed, and uninterrupted ones."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from pacmo_core.data.variation_splits import VariationScales
from pacmo_core.metrics.retargeting import sample_diversity
from pacmo_core.models import model_names
from pacmo_core.skeleton_prior import training
from pacmo_core.skeleton_prior.data import Example, ExampleBatch, encode_examples
from pacmo_core.skeleton_prior.inference import retarget
from pacmo_core.skeleton_prior.layers import initialise_weights
from pacmo_core.skeleton_prior.vae import SkeletonVae, fit_skeleton_vae
from pacmo_core.training.state import model_config, model_state
from tests.skeleton_prior.examples import SMALL, examples, generator, settings


def equal_states(one, other) -> bool:
    return one.keys() == other.keys() and all(torch.equal(one[k], other[k]) for k in one)


@pytest.mark.parametrize("name", model_names("skeleton_prior"))
def test_training_is_deterministic_in_its_seed(name):
    result = []
    for seed in (1, 1, 2):
        chosen = settings(model=name, n_epochs=2, random_seed=seed)
        result.append(model_state(training.build_training(examples(1, 4), chosen).finish()))
    assert equal_states(result[0], result[1])
    assert not equal_states(result[0], result[2])


def test_the_start_is_kept_where_training_lowers_no_validation_error():
    """Training on one set of bodies, validated on what the start itself makes of others."""
    chosen = settings(n_epochs=4, validate_every=1, learning_rate=0.5)
    loop = training.build_training(examples(1, 4), chosen, validation=examples(1, 4))
    validation = loop.trainer.validate()["validation"]
    trained = loop.finish()
    later = [terms["validation"] for terms in loop.curve]
    assert min(later) > validation  # with so high a learning rate
    assert loop.selection() == {"by": "validation", "epoch": 0, "score": float(validation)}
    assert equal_states(model_state(trained), model_state(training_start(chosen)))


def training_start(chosen):
    """Build the same model, not trained."""
    return training.build_training(examples(1, 4), chosen).model


@pytest.mark.parametrize("name", ["kinematic", "m_gcn"])
def test_a_resumed_training_ends_with_the_same_weights(name):
    chosen = settings(model=name)
    uninterrupted = training.build_training(examples(1, 4), chosen, validation=examples(1, 1))
    uninterrupted.finish()
    first = training.build_training(examples(1, 4), chosen, validation=examples(1, 1))
    terms = iter(first)
    next(terms)
    snapshot = first.snapshot()
    again = training.build_training(examples(1, 4), chosen, validation=examples(1, 1))
    again.restore(snapshot)
    again.finish()
    assert equal_states(model_state(uninterrupted.model), model_state(again.model))
    assert uninterrupted.curve == again.curve


@pytest.mark.slow
def test_training_lowers_the_loss():
    chosen = settings(
        n_epochs=40,
        kl_warmup_epochs=1,
        window_frames=11,
        random_rotation=False,
        swap_characters=False,
        learning_rate=1e-2,
    )
    loop = training.build_training(examples(1, 4), chosen)
    loop.finish()
    losses = [terms["loss"] for terms in loop.curve]
    assert np.mean(losses[-5:]) < 0.8 * np.mean(losses[:5])


def two_solutions(metres: float) -> list[Example]:
    """One body, on which the pair stands to either side."""
    (one,) = examples(1, 1)
    sides = [np.float32([side, 0, 0]) for side in (-metres, metres)]
    return [
        replace(
            one,
            variation=replace(
                one.variation,
                person_a=one.variation.person_a + side,
                person_b=one.variation.person_b + side,
            ),
        )
        for side in sides
    ]


@pytest.mark.slow
def test_samples_vary_as_the_solutions_do_where_the_energy_score_is_trained():
    chosen = settings(
        n_epochs=120,
        hidden=32,
        batch_size=8,
        learning_rate=1e-2,
        halve_learning_rate_every=1000,
        random_rotation=False,
        mirror_probability=0.0,
        swap_characters=False,
    )
    scored = replace(chosen, loss_weights=replace(chosen.loss_weights, energy_score=3.0))
    solutions = two_solutions(0.05)
    model = training.build_training(8 * solutions, scored).finish()
    one = solutions[0]
    (drawn,) = retarget(model, one.template, one.scales[None], samples=30, random=generator())
    motions = np.stack([np.stack([m.person_a, m.person_b], axis=1) for m in drawn])
    # Two of the solutions, drawn at random, are 0.1 m apart or equal.
    assert 0.03 < sample_diversity(motions) < 0.08


class Fixed:
    """A model whose samples are the rows of a list, one after the other."""

    displacement_scale = torch.tensor(0.5)

    def __init__(self, *samples: torch.Tensor) -> None:
        self.samples = iter(samples)

    def decode(self, *_: object) -> None:
        """Draw nothing: the samples are fixed."""

    def joint_positions(self, *_: object) -> torch.Tensor:
        """Return the next sample."""
        return next(self.samples)


def test_the_energy_score_is_the_mean_error_less_half_of_the_distance_of_two_samples():
    truth = torch.zeros(1, 4, 2, 3, 3)
    batch = ExampleBatch(truth, truth, torch.ones(1, 2, 3))
    away = truth + torch.tensor([0.3, 0.0, 0.4])  # all joints alike: distances of the two stay
    farther = truth + 2 * torch.tensor([0.3, 0.0, 0.4])
    score = training.sample_energy_score(Fixed(away, farther), batch, generator())
    assert float(score) == pytest.approx(((0.5 + 1.0) / 2 - 0.5 / 2) / 0.5, rel=1e-3)
    same = training.sample_energy_score(Fixed(away, away), batch, generator())
    assert float(same) == pytest.approx(0.5 / 0.5, rel=1e-3)


def test_the_kinematic_model_starts_at_its_initial_output():
    loop = training.build_training(examples(1, 4), settings(n_epochs=1))
    batch = next(encode_examples(examples()).full_length_batches(3, 1))
    outputs = []
    for _ in range(2):
        given = loop.model.first_condition(batch.template, batch.scales)
        with torch.no_grad():
            field, _ = loop.model.decode(batch.template, batch.scales, generator())
        outputs.append(field - given.output)
        loop.finish()
    assert not outputs[0].any() and outputs[1].any()


def test_the_skeleton_vae_is_the_same_in_every_model():
    one, other = (
        training.build_training(examples(1, 4), settings(model=name)).finish()
        for name in ("f_gcn", "kinematic")
    )
    assert equal_states(model_state(one.skeleton_vae), model_state(other.skeleton_vae))


@pytest.mark.parametrize("n", [6, 100])
def test_sampled_skeletons_vary_as_much_as_the_data_of_any_size(n):
    random = generator()
    scales = torch.ones(n, 20)
    scales[torch.arange(n), torch.randint(1, 20, (n,), generator=random)] = 1.03
    scales[: n // 3, 1:] = 0.98
    bodies = SkeletonVae(20, 0)
    initialise_weights(bodies, random)
    before, expected = spread(bodies.sample(500, random)), spread(scales)
    fit_skeleton_vae(bodies, scales, n_steps=1000, random=random)
    assert before / expected > 2
    assert 2 / 3 < spread(bodies.sample(500, random)) / expected < 3 / 2


def test_the_skeleton_vae_covers_large_deviations():
    scales = torch.ones(50, 4)
    scales[::2, 1:] = 0.6
    bodies = SkeletonVae(4, 0)
    initialise_weights(bodies, generator())
    fit_skeleton_vae(bodies, scales, n_steps=500, random=generator())
    drawn = bodies.sample(500, generator())
    assert drawn.min() < 0.7
    assert bodies.decode(100 * torch.randn(500, 16, generator=generator())).min() > 0


def test_a_window_too_short_for_a_second_difference_is_refused():
    with pytest.raises(ValueError, match="window_frames must be at least 3.*got 2"):
        settings(window_frames=2)


def spread(scales: torch.Tensor) -> float:
    return (scales - 1).square().mean().sqrt().item()


def test_a_model_is_rebuilt_from_its_state():
    model = training.build_training(examples(1, 4), settings(n_epochs=1)).finish()
    again = training.prior_from_state(model_config(model), model_state(model))
    batch = next(encode_examples(examples()).full_length_batches(3, 1))
    with torch.no_grad():
        one, other = (
            m.joint_positions(
                m.decode(batch.template, batch.scales, generator()), batch.template, batch.scales
            )
            for m in (model.eval(), again)
        )
    assert torch.equal(one, other)


def test_the_changed_person_is_the_first_character():
    for example in examples():
        encoded = encode_examples([example])
        own = encoded.scales[0]
        assert (own[0] != 1).any() and (own[1] == 1).all()
        bones = torch.from_numpy(SMALL.bones)
        motion = encoded.variations[0]
        lengths = (motion[:, :, bones[:, 1]] - motion[:, :, bones[:, 0]]).norm(dim=-1)
        template = encoded.templates[0]
        expected = (template[:, :, bones[:, 1]] - template[:, :, bones[:, 0]]).norm(dim=-1)
        torch.testing.assert_close(lengths, expected * own[:, bones[:, 1]], atol=1e-5, rtol=1e-4)


def test_rotating_and_swapping_preserve_distances_and_bones():
    encoded = encode_examples(examples())
    batch = encoded.random_windows(torch.arange(len(encoded)), 2, 7, generator())
    turned = batch.rotated(torch.linspace(0, 6, len(encoded)))
    assert not torch.allclose(turned.variation, batch.variation, atol=0.1)
    torch.testing.assert_close(turned.variation[..., 1], batch.variation[..., 1])
    gaps = [torch.cdist(p.variation[:, :, 0], p.variation[:, :, 1]) for p in (batch, turned)]
    torch.testing.assert_close(gaps[0], gaps[1], atol=1e-4, rtol=1e-4)
    every = torch.ones(len(encoded), dtype=torch.bool)
    back = batch.swapped(every).swapped(every)
    assert isinstance(back, ExampleBatch) and torch.equal(back.variation, batch.variation)
    assert torch.equal(batch.swapped(every).scales[:, 0], batch.scales[:, 1])
    assert torch.equal(batch.swapped(~every).template, batch.template)


def test_a_mirrored_motion_is_that_of_the_mirrored_skeleton():
    encoded = encode_examples(examples())
    batch = encoded.random_windows(torch.arange(len(encoded)), 2, 7, generator())
    every = torch.ones(len(encoded), dtype=torch.bool)
    once = batch.mirrored(every, SMALL)
    left, right = SMALL.left_right[2]
    flipped = batch.variation[..., left, :] * torch.tensor([-1.0, 1.0, 1.0])
    assert torch.equal(once.variation[..., right, :], flipped)
    assert torch.equal(once.scales[..., right], batch.scales[..., left])
    back = once.mirrored(every, SMALL)
    assert torch.equal(back.variation, batch.variation)
    assert torch.equal(batch.mirrored(~every, SMALL).template, batch.template)


def test_full_length_batches_hold_all_examples_for_any_batch_size():
    encoded = encode_examples(examples())
    alone, together = (list(encoded.full_length_batches(3, most)) for most in (1, 100))
    assert len(alone) == len(encoded) and len(together) == len(encoded.templates)
    for name in ("template", "variation", "scales"):
        assert torch.equal(
            torch.cat([getattr(batch, name)[:, :1] for batch in alone]),
            torch.cat([getattr(batch, name)[:, :1] for batch in together]),
        )


def test_windows_are_frames_of_their_examples_and_repeat_the_last():
    encoded = encode_examples(examples())
    batch = encoded.random_windows(torch.tensor([3, 0]), 3, 20, generator())
    assert batch.variation.shape[:2] == (2, 20)
    assert torch.equal(batch.variation[0, -1], encoded.variations[3][-1])
    assert torch.equal(batch.variation[0, 0], encoded.variations[3][0])
    short = encoded.random_windows(torch.tensor([3]), 3, 4, generator())
    frames = encoded.variations[3]
    at = int((frames - short.variation[0, 0]).abs().sum(dim=(1, 2, 3)).argmin())
    assert torch.equal(short.variation[0], frames[at : at + 12 : 3])


def test_examples_of_the_wrong_shape_are_refused():
    good = examples()[0]
    with pytest.raises(ValueError, match=r"scales must be \(2, 13\)"):
        Example("x", good.template, good.scales[:, :5], good.variation)
    with pytest.raises(ValueError, match="variation must be"):
        Example("x", good.template, good.scales, good.variation.frames(0, 10))
    assert VariationScales("x", good.scales).max_deviation > 0
