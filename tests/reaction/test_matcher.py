"""Trusted: the metric of matching on pairs of a known distribution; the mirror of a mirror."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch

from pacmo_core.metrics.diversity import matching_accuracy as share_matched
from pacmo_core.reaction import matcher
from pacmo_core.reaction.data import mirror_interaction, sample_motion_pairs
from pacmo_core.reaction.settings import MatcherSettings
from pacmo_core.training.state import model_config, model_state
from tests.reaction.problems import clips

SETTINGS = MatcherSettings(
    random_seed=0,
    n_points=17,
    period=1.25,
    width=8,
    modes=[6, 4, 4],
    embedding_channels=4,
    n_times=4,
    temperature=0.1,
    joint_noise=0.01,
    learning_rate=5e-3,
    halve_learning_rate_every=20,
    batch_size=32,
    n_epochs=10,
    validate_every=1,
    checkpoint_every=5,
    device="cpu",
    mirror=False,
)


def picked(model, some):
    codes = np.arange(len(some))
    embedded = np.stack(matcher.embed(model, some))
    return share_matched(embedded, codes, np.ones((1, len(some))), candidates=16)[0]


@pytest.fixture(scope="module")
def trained():
    return matcher.build_training(clips(32), SETTINGS, validation=clips(8, 500)).finish()


def test_it_picks_the_partner_of_a_reaction_that_follows_among_clips_it_never_saw(trained):
    assert picked(trained, clips(20, 900)) > 0.25  # a guess: 1 / 16


def test_embeddings_are_unit_vectors_and_know_no_scale_of_the_batch(trained):
    some = clips(6, 900)
    partner, reaction = matcher.embed(trained, some)
    assert partner.shape == reaction.shape == (6, 16)
    np.testing.assert_allclose(np.linalg.norm(partner, axis=1), 1, atol=1e-6)
    np.testing.assert_allclose(matcher.embed(trained, some[:2])[0], partner[:2], atol=1e-5)


def test_a_model_is_rebuilt_from_its_configuration_and_state(trained):
    facts = json.loads(json.dumps(model_config(trained)))
    again = matcher.matcher_from_state(facts, model_state(trained))
    some = clips(3, 900)
    for ours, theirs in zip(matcher.embed(trained, some), matcher.embed(again, some), strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_the_weights_of_the_least_validation_loss_are_kept():
    held_out = clips(8, 500)
    fit = matcher.build_training(clips(10), replace(SETTINGS, n_epochs=6), validation=held_out)
    least = min(terms["validation"] for terms in fit)
    both = [*held_out, *(clip.swapped() for clip in held_out)]
    codes = torch.arange(8).repeat(2)
    found = fit.model.loss(sample_motion_pairs(both, SETTINGS.n_points), codes)
    assert float(found.detach()) == pytest.approx(least, rel=1e-5)


def test_one_random_seed_gives_one_model():
    settings = replace(SETTINGS, n_epochs=1, mirror=True)
    states = [
        model_state(matcher.build_training(clips(6), s).finish())
        for s in (settings, settings, replace(settings, random_seed=1))
    ]
    assert all(torch.equal(states[0][name], states[1][name]) for name in states[0])
    assert any(not torch.equal(states[0][name], states[2][name]) for name in states[0])


def test_the_other_view_of_a_clip_is_no_rival_in_training(trained):
    pairs = sample_motion_pairs([*clips(2), *clips(2)], SETTINGS.n_points)
    alone = trained.loss(pairs[torch.tensor([0, 1])], torch.tensor([0, 1]))
    doubled = trained.loss(pairs, torch.tensor([0, 1, 0, 1]))
    # Every pair stands twice, but its copy is masked; the one true rival counts twice.
    assert float(doubled.detach()) > float(alone.detach())
    unmasked = trained.loss(pairs, torch.arange(4))
    assert float(unmasked.detach()) > float(doubled.detach())


def test_a_mirrors_mirror_is_the_interaction_and_left_is_right():
    (clip,) = clips(1)
    once = mirror_interaction(clip)
    np.testing.assert_array_equal(mirror_interaction(once).person_b, clip.person_b)
    left, right = (clip.skeleton.joints.index(f"{side}_hand") for side in ("left", "right"))
    np.testing.assert_array_equal(once.person_a[:, left, 0], -clip.person_a[:, right, 0])
    np.testing.assert_array_equal(once.person_a[:, left, 1:], clip.person_a[:, right, 1:])
