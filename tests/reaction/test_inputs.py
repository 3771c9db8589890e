"""Truth: partners that all move alike, whose reaction only the label tells."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.skeleton import SBU15
from pacmo_core.reaction import wgan
from pacmo_core.reaction.data import Condition, sample_motion_pairs
from pacmo_core.reaction.inputs import ActionEmbedding, action_indices
from pacmo_core.reaction.settings import AdamSettings
from tests.reaction.problems import NO_AUGMENTATION, PACMO, REST

LABELLED = replace(
    PACMO,
    action_channels=2,
    generator=AdamSettings(5e-3, (0.9, 0.99)),
    energy_score_weight=20.0,
    n_critic=1,
    ema_decay=0.9,
    n_epochs=200,
    validate_every=200,
    both_directions=False,
    augmentation=NO_AUGMENTATION,
)


def stepping(forwards: bool) -> Interaction:
    """Let a partner rest, and another step forward or back."""
    times = np.arange(20) / 15
    partner = np.tile(REST, (20, 1, 1)).astype(np.float32)
    reaction = np.tile(REST * [-1, 1, -1] + [0, 0, 1.5], (20, 1, 1)).astype(np.float32)
    reaction[:, :, 2] += ((-0.5 if forwards else 0.5) * times / times[-1])[:, None]
    return Interaction(SBU15, times, partner, reaction)


@pytest.mark.slow
def test_the_generator_learns_what_depends_on_the_label_alone() -> None:
    clips = [stepping(i % 2 == 0) for i in range(16)]
    labels = ["forward", "back"] * 8
    model = wgan.build_training(clips, LABELLED, actions=labels).finish()
    assert model.config.actions == ("back", "forward")
    pairs = sample_motion_pairs([stepping(forwards=True)], PACMO.n_points)
    noise = model.sample_noise(1, torch.Generator().manual_seed(0))
    back, forward = (
        model(noise, Condition(pairs.partner, pairs.log_duration, torch.tensor([number])))
        for number in (0, 1)
    )
    # The torso's z at the end: 1.0 after a step forward, 2.0 after one back.
    assert float(forward[0, -1, 8]) == pytest.approx(1.0, abs=0.25)
    assert float(back[0, -1, 8]) == pytest.approx(2.0, abs=0.25)


def test_a_labels_function_is_the_network_of_the_instant_and_the_label() -> None:
    function = ActionEmbedding(n_actions=3, channels=2)
    times = torch.tensor([0.0, 0.25])
    found = function(torch.tensor([2, 0]), times, 1.0)
    # At a quarter of the period sine is one and cosine zero; label 2 is (0, 0, 1).
    by_hand = function.network(torch.tensor([1.0, 0.0, 0.0, 0.0, 1.0]))
    assert found.shape == (2, 2, 2)
    torch.testing.assert_close(found[0, 1], by_hand, atol=1e-6, rtol=1e-5)


def test_without_actions_a_label_changes_nothing() -> None:
    model = wgan.build_training([stepping(forwards=True)] * 4, PACMO).model
    pairs = sample_motion_pairs([stepping(forwards=True)], PACMO.n_points)
    noise = model.sample_noise(1, torch.Generator().manual_seed(0))
    one, other = (
        model(noise, Condition(pairs.partner, pairs.log_duration, torch.tensor([number])))
        for number in (0, 5)
    )
    assert torch.equal(one, other)


def test_a_label_that_was_not_trained_on_is_refused_by_name() -> None:
    with pytest.raises(ValueError, match="one of hug, push; got 'wave'"):
        action_indices(["push", "wave"], ["hug", "push"])


def test_labels_that_are_wanted_and_missing_are_refused() -> None:
    with pytest.raises(ValueError, match="a label a clip: 2 and 0; got 0 and 0"):
        wgan.build_training([stepping(forwards=True)] * 2, LABELLED)
