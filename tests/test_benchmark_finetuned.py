"""Truth: copies of captured reactions, whose place beside their own partner is known."""

from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np
import pytest

from benchmarks import finetuned
from benchmarks.finetuned import Fold, another, nearest, read_fold
from pacmo_core.api import synthesise
from pacmo_core.data.interaction import Interaction
from pacmo_core.reaction.data import expand_directions, to_partner_frame
from pacmo_core.reaction.generator import Generator
from pacmo_core.store.motions import write_motions
from pacmo_core.store.tables import ClipRecord, SplitRecord, write_rows
from tests.stages.training import FACTS

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
    pairs = another(MODEL, 2, fold, ACT)
    half = len(fold.acts[ACT]) // 2
    assert len(pairs) == 2 * half
    for number, (clip, motions) in enumerate(pairs):
        np.testing.assert_allclose(clip.person_a, to_partner_frame(fold.acts[ACT][number]).person_a)
        sources = fold.train[ACT] if number < half else [c.swapped() for c in fold.train[ACT]]
        known = [to_partner_frame(source).person_b[[0, -1]] for source in sources]
        found = [
            [np.allclose(motion[[0, -1]], ends, atol=1e-4) for ends in known].index(True)
            for motion in motions
        ]
        assert len(set(found)) == 2, "two different ones"


def test_a_partner_that_was_trained_on_gets_its_own_reaction_first(fold: Fold) -> None:
    # Read anew, as a clip of another file is: a clip itself is never a neighbour of its own.
    read = [
        replace(clip, person_a=clip.person_a.copy(), person_b=clip.person_b.copy())
        for clip in fold.train[ACT]
    ]
    known = Fold(1, {ACT: read}, {ACT: ["pair"] * len(read)}, fold.train)
    for clip, motions in nearest(MODEL, 2, known, ACT):
        assert len(motions) == 2
        np.testing.assert_allclose(motions[0], clip.person_b, atol=1e-4)
        assert np.abs(motions[1] - clip.person_b).max() > 0.01


def test_a_clip_is_no_neighbour_of_its_own(fold: Fold) -> None:
    known = Fold(1, {ACT: fold.train[ACT]}, {ACT: ["pair"] * len(fold.train[ACT])}, fold.train)
    for clip, motions in nearest(MODEL, 2, known, ACT):
        for motion in motions:
            assert np.abs(motion - clip.person_b).max() > 0.01


def test_acts_that_are_not_trained_on_are_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (pair,) = clips(11, 1)
    names = {"a": ("hug", "train"), "b": ("hug", "test"), "c": ("kick", "test")}
    Path("data/clips").mkdir(parents=True)
    Path("data/splits").mkdir()
    with write_motions(Path("data/clips/motions.parquet"), pair.skeleton) as writer:
        for name in names:
            writer.add(name, pair)
    rows = [
        replace(FACTS, clip=name, action=act, subject_a="s02", subject_b="s01", recording=name)
        for name, (act, _) in names.items()
    ]
    write_rows(Path("data/clips/clips.parquet"), ClipRecord, rows)
    for number, last in ((1, "test"), (2, "train")):
        split = [SplitRecord(n, of if n != "b" else last) for n, (_, of) in names.items()]
        write_rows(Path(f"data/splits/{number}.parquet"), SplitRecord, split)
    found = read_fold(1)
    assert (list(found.acts), list(found.train)) == (["hug"], ["hug"])
    assert found.people == {"hug": ["s01+s02", "s01+s02"]}
    with pytest.raises(SystemExit, match=r"2.parquet: wanted test clips of an act that is trained"):
        read_fold(2)
