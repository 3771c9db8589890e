"""Truth: partners that all move alike, whose reaction only the label tells."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.skeleton import SBU15
from pacmo_core.reaction import wgan
from pacmo_core.reaction.data import Condition, sample_motion_pairs
from pacmo_core.reaction.inference import react_all
from pacmo_core.reaction.inputs import ActionEmbedding, action_indices
from pacmo_core.reaction.settings import AdamSettings
from pacmo_core.reaction.windows import PartnerMotion, action_index
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


@pytest.mark.slow
def test_a_model_whose_labels_were_withheld_now_and_then_reacts_without_one_too() -> None:
    clips = [stepping(i % 2 == 0) for i in range(16)]
    settings = replace(LABELLED, action_dropout=0.5)
    model = wgan.build_training(clips, settings, actions=["forward", "back"] * 8).finish()
    assert model.config.actions == ("", "back", "forward")
    partner, times = clips[0].person_a, clips[0].times

    def ends(action: str) -> np.ndarray:
        """Where the torso is at the end, in 32 samples."""
        motion = PartnerMotion(partner, times, times, action)
        random = torch.Generator().manual_seed(0)
        (reactions,) = react_all(model, [motion], n_samples=32, random=random)
        return reactions[:, -1, 2, 2] - clips[0].person_a[-1, 2, 2]

    there = stepping(forwards=True).person_b[-1, 2, 2] - clips[0].person_a[-1, 2, 2]
    here = stepping(forwards=False).person_b[-1, 2, 2] - clips[0].person_a[-1, 2, 2]
    assert np.median(ends("forw")) == pytest.approx(there, abs=0.3)
    assert np.median(ends("BACK")) == pytest.approx(here, abs=0.3)
    # Without a label samples are of both.
    between = (there + here) / 2
    assert 0.2 < (ends("") < between).mean() < 0.8


def test_labels_are_withheld_from_the_share_of_pairs_that_is_stated() -> None:
    settings = replace(LABELLED, action_dropout=0.25, batch_size=64)
    clips = [stepping(i % 2 == 0) for i in range(64)]
    trainer = wgan.build_training(clips, settings, actions=["forward", "back"] * 32).trainer
    seen = [trainer._sample_batch(for_critic=True).real.action for _ in range(40)]
    withheld = float((torch.cat(seen) == 0).float().mean())
    assert withheld == pytest.approx(0.25, abs=0.04)  # 5 standard deviations of 2,560 pairs


def test_words_name_the_only_label_that_contains_them() -> None:
    settings = replace(LABELLED, action_dropout=0.5)
    labels = ["A1 shake hands", "A2 hand over", "A2 hand"]
    model = wgan.build_training([stepping(True)] * 3, settings, actions=labels).model
    assert action_index(model, "") == 0
    assert action_index(model, "SHAKE") == model.config.actions.index("A1 shake hands")
    assert action_index(model, "A2 hand") == model.config.actions.index("A2 hand")
    with pytest.raises(ValueError, match="one of A1 shake hands, A2 hand, A2 hand over; got 'han"):
        action_index(model, "hand")


def test_a_share_of_withheld_labels_wants_labels() -> None:
    with pytest.raises(ValueError, match="action_channels above 0; got 0.5, action_channels 0"):
        replace(PACMO, action_dropout=0.5)


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
