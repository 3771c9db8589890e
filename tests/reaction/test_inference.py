"""Truth: one function, however it was sampled; one partner, however the world is turned."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.transforms import Frame
from pacmo_core.finish import learning
from pacmo_core.finish.contacts import find_pairs, no_contacts
from pacmo_core.models import MODELS
from pacmo_core.reaction import baselines, wgan
from pacmo_core.reaction.generator import Generator
from pacmo_core.reaction.inference import react, react_all
from pacmo_core.reaction.windows import PartnerMotion
from pacmo_core.training.loop import TrainingData
from tests.reaction.problems import GRU, PACMO_LONG, REGRESSION, clips, delayed_mirror

COMMON = np.linspace(0, 2, 21)


@pytest.fixture(scope="module")
def trained() -> Generator:
    """Weights of a short training: fresh ones look ten times more invariant than they are."""
    return wgan.build_training(clips(32), replace(PACMO_LONG, n_epochs=40)).finish()


def sampled(times: np.ndarray) -> Interaction:
    return delayed_mirror(7, times)


def reacted(model: Generator, partner: Interaction, at: np.ndarray = COMMON) -> np.ndarray:
    random = torch.Generator().manual_seed(3)
    return react(model, partner.person_a, partner.times, out_times=at, n_samples=2, random=random)


def irregular(kind: str) -> np.ndarray:
    random = np.random.default_rng(0)
    times = np.linspace(0, 2, 129)
    if kind == "jittered":
        times[1:-1] += random.uniform(-0.4, 0.4, 127) * times[1]
        return times
    keep = np.sort(random.permutation(np.arange(1, 128))[:89])
    return times[[0, *keep, 128]]


@pytest.mark.parametrize(
    "times",
    [np.linspace(0, 2, 257), np.linspace(0, 2, 513), irregular("jittered"), irregular("dropped")],
    ids=["2x", "4x", "jittered", "dropped"],
)
def test_the_reaction_does_not_depend_on_how_the_partner_was_sampled(
    trained: Generator, times: np.ndarray
) -> None:
    base, other = (
        reacted(trained, sampled(np.linspace(0, 2, 129))),
        reacted(trained, sampled(times)),
    )
    assert np.linalg.norm(base - other) <= 1e-3 * np.linalg.norm(base)


def test_the_reaction_at_30_and_at_120_frames_a_second_is_one_function(trained: Generator) -> None:
    partner = sampled(np.linspace(0, 2, 61))
    slow = reacted(trained, partner, np.linspace(0, 2, 61))
    fast = reacted(trained, partner, np.linspace(0, 2, 241))
    np.testing.assert_allclose(fast[:, ::4], slow, atol=1e-5)
    assert fast.shape == (2, 241, 15, 3)
    assert fast.dtype == np.float32


def test_partners_of_any_lengths_in_one_batch_react_as_if_alone(trained: Generator) -> None:
    partners = [PartnerMotion(c.person_a, c.times, c.times) for c in clips(5, first_seed=20)]
    together = react_all(trained, partners, n_samples=2, random=torch.Generator().manual_seed(0))
    random = torch.Generator().manual_seed(0)
    for partner, motion in zip(partners, together, strict=True):
        (alone,) = react_all(trained, [partner], n_samples=2, random=random)
        np.testing.assert_allclose(motion, alone, atol=1e-5)


def test_reacting_commutes_with_turning_and_shifting_the_world(trained: Generator) -> None:
    partner = sampled(np.linspace(0, 2, 61))
    world = Frame(origin=np.array([1.0, 0.3, -2.0]), yaw=2.0)
    moved = replace(partner, person_a=world.to_world(partner.person_a))
    np.testing.assert_allclose(
        reacted(trained, moved), world.to_world(reacted(trained, partner)), atol=1e-4
    )


def test_samples_differ_and_a_seed_repeats_them(trained: Generator) -> None:
    partner = sampled(np.linspace(0, 2, 61))
    first = reacted(trained, partner)
    assert np.array_equal(first, reacted(trained, partner))
    assert np.abs(first[0] - first[1]).max() > 1e-4


def test_the_baseline_gives_one_reaction_and_refuses_more() -> None:
    model = baselines.build_gru_training(clips(8), replace(GRU, n_epochs=1)).finish()
    partner = sampled(np.linspace(0, 2, 61))
    random = torch.Generator().manual_seed(0)
    motion = react(
        model, partner.person_a, partner.times, out_times=COMMON, n_samples=1, random=random
    )
    assert motion.shape == (1, 21, 15, 3)
    with pytest.raises(ValueError, match="deterministic"):
        react(model, partner.person_a, partner.times, out_times=COMMON, n_samples=2, random=random)


def test_a_wrong_body_and_instants_outside_the_motion_are_refused(trained: Generator) -> None:
    partner = sampled(np.linspace(0, 2, 61))
    with pytest.raises(ValueError, match=r"\(61, 15, 3\)"):
        reacted(trained, partner.without(["head"]))
    with pytest.raises(ValueError, match=r"\[0, 2\]"):
        reacted(trained, partner, np.array([0.0, 2.5]))


@pytest.mark.parametrize(("name", "settings"), [("regression", REGRESSION), ("gru", GRU)])
@pytest.mark.parametrize("least", [2, 3])
def test_a_trained_model_learns_its_contacts_on_validation_clips_and_others_if_these_are_few(
    monkeypatch: pytest.MonkeyPatch, name: str, settings: object, least: int
) -> None:
    monkeypatch.setattr(learning, "MIN_FITTED_CLIPS", least)
    marker, seen = no_contacts(clips(1)[0].skeleton) + 1, []

    def learn(pairs, skeleton):
        seen.extend(captured.distance for _, captured in pairs)
        return marker

    monkeypatch.setattr(learning, "learn_contacts", learn)
    held_out = clips(2, first_seed=90)
    model = MODELS[name].build_training(TrainingData(clips(4), held_out), settings).finish()
    np.testing.assert_allclose(model.learnt.read().contacts, marker)
    expected = [
        find_pairs(clip.person_b, clip.person_a, 1 / np.median(np.diff(clip.times)), clip.skeleton)
        for held in [*held_out, *(clips(4) if least > len(held_out) else [])]
        for clip in (held, held.swapped())
    ]
    assert len(seen) == len(expected)
    for found, pairs in zip(seen, expected, strict=True):
        np.testing.assert_allclose(found, pairs.distance)
