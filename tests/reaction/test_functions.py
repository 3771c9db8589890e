"""Truth: the people of an interaction, whose roles and world are conventions."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from pacmo_core.data.transforms import Frame, frame_of
from pacmo_core.operators.initialise import initialise
from pacmo_core.reaction.functions import both_sides, encode
from pacmo_core.reaction.normalisation import Normalisation
from pacmo_core.reaction.tensors import running_mean, update_mean
from tests.reaction.problems import clips, mirrored


def test_a_partner_starts_at_the_origin_and_frames_on_the_grid_are_kept() -> None:
    clip = mirrored(3, np.linspace(0, 2, 33))
    pairs = encode([clip], 17)
    local = frame_of(clip.person_a, clip.skeleton).to_local(clip.person_b)[::2].reshape(17, -1)
    np.testing.assert_allclose(pairs.reaction[0].numpy(), local, atol=1e-5)
    np.testing.assert_allclose(pairs.partner[0, 0, 6:9].numpy(), 0, atol=1e-6)
    assert pairs.log_duration.item() == pytest.approx(math.log(2))


def test_functions_do_not_change_when_the_world_turns() -> None:
    clip = mirrored(3, np.linspace(0, 2, 33))
    world = Frame(origin=np.array([3.0, 1.0, -2.0]), yaw=1.2)
    moved = replace(
        clip, person_b=world.to_world(clip.person_b), person_a=world.to_world(clip.person_a)
    )
    here, there = encode([clip], 17), encode([moved], 17)
    torch.testing.assert_close(there.reaction, here.reaction, atol=1e-5, rtol=0)
    torch.testing.assert_close(there.partner, here.partner, atol=1e-5, rtol=0)


def test_both_sides_hold_each_interaction_and_its_exchange() -> None:
    some = clips(3)
    sides = both_sides(some, swap=True)
    assert len(sides) == 6
    assert np.array_equal(sides[4].person_b, some[1].person_a)
    assert both_sides(some, swap=False) == some


def test_bodies_of_different_joints_are_refused() -> None:
    first, second = clips(2)
    with pytest.raises(ValueError, match="one skeleton"):
        encode([first, second.without(["head"])], 17)
    with pytest.raises(ValueError, match="no interaction"):
        encode([], 17)


def test_normalised_training_data_are_centred_and_of_unit_scale_and_come_back() -> None:
    pairs = encode(clips(20), 17)
    norm = Normalisation(channels=45)
    norm.measure(pairs)
    both = torch.cat([norm.partner(pairs.partner), norm.reaction(pairs.reaction)])
    assert both.mean().abs() < 1e-5
    assert both.square().mean().item() == pytest.approx(1, rel=1e-5)
    again = norm.metres(norm.reaction(pairs.reaction))
    torch.testing.assert_close(again, pairs.reaction, atol=1e-6, rtol=1e-5)


def test_the_running_mean_is_the_past_with_falling_weights() -> None:
    model = torch.nn.Linear(3, 2)
    initialise(model, torch.Generator().manual_seed(0))
    mean, start = running_mean(model), model.weight.detach().clone()
    with torch.no_grad():
        model.weight.add_(1)
    for _ in range(3):
        update_mean(mean, model, 0.9)
    torch.testing.assert_close(mean.weight, start + 1 - 0.9**3)
    assert not mean.weight.requires_grad
