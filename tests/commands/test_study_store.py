"""Truth: the answers that were given; the promise that the first to a place stands."""

from pathlib import Path

import pytest

from pacmo_core.commands.study_store import GENERATED, REAL, Item, Study, write_study
from pacmo_core.store.files import StoreError

ITEMS = [Item(kind, f"s{k}", f"[{k}]") for k in range(3) for kind in (REAL, GENERATED)]


@pytest.fixture
def study(tmp_path: Path) -> Study:
    write_study(tmp_path / "s.sqlite", ITEMS, {"of": "x"})
    return Study(tmp_path / "s.sqlite")


def test_the_first_answer_to_a_place_stands(study: Study) -> None:
    assert study.begin("ann", lambda seen: [seen[3].item, seen[0].item], 9) == 2
    assert study.answer("ann", 1, real=True)
    assert study.answer("ann", 1, real=False)
    (only,) = study.answers()
    assert (only.person, only.kind, only.real) == ("ann", REAL, True)
    assert study.progress("ann") == (2, [1])


def test_places_are_a_participants_own(study: Study) -> None:
    study.begin("ann", lambda seen: [seen[0].item], 9)
    assert study.scene("ann", 0) == "[0]"
    assert study.scene("bob", 0) is None
    assert study.scene("ann", 1) is None
    assert not study.answer("bob", 0, real=True)
    assert not study.answer("ann", 1, real=True)
    assert study.answers() == []
    assert study.progress("bob") == (0, [])


def test_what_was_shown_is_counted_for_the_next_draw(study: Study) -> None:
    study.begin("ann", lambda seen: [seen[2].item], 9)
    assert [c.times_shown for c in study.candidates()] == [0, 0, 1, 0, 0, 0]


def test_a_draw_that_fails_leaves_nothing(study: Study) -> None:
    with pytest.raises(ZeroDivisionError):
        study.begin("ann", lambda _: [1 // 0], 9)
    assert study.progress("ann") == (0, [])
    assert study.begin("ann", lambda seen: [seen[0].item], 9) == 1


def test_answers_outlive_the_process(study: Study, tmp_path: Path) -> None:
    study.begin("ann", lambda seen: [seen[0].item], 9)
    study.answer("ann", 0, real=False)
    study.close()
    assert len(Study(tmp_path / "s.sqlite").answers()) == 1


def test_a_study_is_not_written_over_and_other_files_are_none(tmp_path: Path, study: Study) -> None:
    with pytest.raises(FileExistsError):
        write_study(tmp_path / "s.sqlite", ITEMS, {"of": "x"})
    with pytest.raises(StoreError, match="no such study"):
        Study(tmp_path / "none")
    (tmp_path / "text").write_text("no database at all, but longer than a header of one " * 9)
    with pytest.raises(StoreError, match="not a study"):
        Study(tmp_path / "text")
    (tmp_path / "empty").touch()
    with pytest.raises(StoreError, match="version 1, got 0"):
        Study(tmp_path / "empty")


def test_of_more_people_than_wanted_nothing_is_kept(study: Study) -> None:
    assert study.begin("ann", lambda seen: [seen[0].item], 1) == 1
    assert study.begin("bob", lambda seen: [seen[0].item], 1) == 0
    assert study.progress("bob") == (0, [])


def test_a_study_says_what_it_was_made_of(study: Study) -> None:
    assert study.facts() == {"of": "x"}
