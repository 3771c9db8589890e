"""Trusted: clips whose nearest neighbour is known, and frames that are moved in the world."""

from dataclasses import replace

import numpy as np
import pytest

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.skeleton import NTU25
from pacmo_core.data.transforms import Frame, body_frame
from pacmo_core.metrics.untrained import TrainingReactions

N = 9
BODY = np.random.default_rng(0).normal(size=(25, 3))


def clip(reach, n=N, rate=30.0):
    """Return two people: the partner moves along z by ``reach``, the other rises by it."""
    phase = np.linspace(0, 1, n)[:, None, None]
    times = np.arange(n) / rate
    partner = BODY + phase * [0, 0, reach]
    reaction = BODY + [0, 0, 2.0] + phase * [0, reach, 0]
    return Interaction(NTU25, times, partner.astype(np.float32), reaction.astype(np.float32))


def data(*reaches, n_points=N):
    return TrainingReactions.of([clip(reach) for reach in reaches], n_points)


def test_the_reaction_of_the_nearest_partner_is_copied():
    found = data(0.1, 0.5, 1.0).nearest(clip(0.56))
    np.testing.assert_allclose(found, clip(0.5).person_b, atol=1e-5)


def test_both_directions_of_a_training_clip_are_copied():
    found = data(0.1, 0.5).nearest(clip(0.5).swapped())
    np.testing.assert_allclose(found, clip(0.5).person_a, atol=1e-5)


def test_the_reaction_of_the_test_clip_is_not_looked_at():
    test = clip(0.56)
    other = replace(test, person_b=test.person_b + np.float32(3))
    np.testing.assert_array_equal(data(0.1, 0.5).nearest(test), data(0.1, 0.5).nearest(other))


def test_a_copy_takes_the_place_and_the_times_of_the_test_partner():
    place = Frame(np.array([3.0, 0.0, -1.0]), 0.7)
    test = clip(0.5, n=21, rate=15.0)
    moved = replace(
        test, person_a=place.to_world(test.person_a), person_b=place.to_world(test.person_b)
    )
    found = data(0.1, 0.5).nearest(moved)
    np.testing.assert_allclose(found, moved.person_b, atol=1e-4)


def test_the_mean_is_over_all_training_reactions_in_both_directions():
    training = data(0.2, 0.6)
    frames = [body_frame(c.person_a, NTU25) for c in training.interactions]
    locals_ = [f.to_local(c.person_b) for f, c in zip(frames, training.interactions, strict=True)]
    test = clip(0.3)
    expected = body_frame(test.person_a, NTU25).to_world(np.mean(locals_, axis=0))
    np.testing.assert_allclose(training.mean(test), expected, atol=1e-5)


def test_without_training_clips_there_is_nothing_to_copy():
    with pytest.raises(ValueError, match="got none"):
        TrainingReactions.of([], N)
