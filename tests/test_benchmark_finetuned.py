"""Truth: copies of captured reactions, whose place beside their own partner is known."""

from typing import cast

import numpy as np
import pytest

from benchmarks import finetuned
from benchmarks.finetuned import Fold, another, nearest
from pacmo_core.api import synthesise
from pacmo_core.data.interaction import Interaction
from pacmo_core.reaction.data import expand_directions, to_partner_frame
from pacmo_core.reaction.generator import Generator

ACT = "handshake"
MODEL = cast("Generator", None)  # whose finish is left out


def clips(n: int, random_seed: int) -> list[Interaction]:
    made = synthesise(n, random_seed=random_seed)
    return [clip for name, clip in made.items() if name.startswith(ACT)]


@pytest.fixture
def fold(monkeypatch: pytest.MonkeyPatch) -> Fold:
    """Return a fold whose copies are not finished, so that they can be compared."""
    monkeypatch.setattr(finetuned, "finished", lambda _model, _clip, motions: motions)
    test, train = clips(22, 1), clips(33, 2)
    both = expand_directions(test, both=True)
    return Fold(1, {ACT: both}, {ACT: ["pair"] * len(both)}, {ACT: train})


def test_a_copy_keeps_its_role_and_its_place_beside_the_partner(fold: Fold) -> None:
    pairs = another(MODEL, fold, ACT)
    assert len(pairs) == len(fold.acts[ACT])
    half = len(pairs) // 2
    for number, (clip, motions) in enumerate(pairs):
        source = fold.train[ACT][number % half % len(fold.train[ACT])]
        source = to_partner_frame(source.swapped() if number >= half else source)
        np.testing.assert_allclose(motions[0, [0, -1]], source.person_b[[0, -1]], atol=1e-4)
        np.testing.assert_allclose(clip.person_a, to_partner_frame(fold.acts[ACT][number]).person_a)


def test_a_partner_that_was_trained_on_gets_its_own_reaction(fold: Fold) -> None:
    known = Fold(1, {ACT: fold.train[ACT]}, {ACT: ["pair"] * len(fold.train[ACT])}, fold.train)
    for clip, motions in nearest(MODEL, known, ACT):
        np.testing.assert_allclose(motions[0], clip.person_b, atol=1e-4)
