"""Truth: the answers that were acknowledged, kept beside by those who sent them."""

import asyncio
from pathlib import Path

import pytest

from benchmarks.study import (
    ATTACKS,
    PER_PERSON,
    Answers,
    answer_all,
    answer_through_kills,
    kept_out,
    raise_file_limit,
)
from tests.commands.studies import served, small_study

pytestmark = pytest.mark.slow


@pytest.fixture
def study(tmp_path: Path) -> Path:
    return small_study(tmp_path / "s.sqlite")


def check(answers: Answers, people: int) -> None:
    assert len(answers.kept) == len(answers.held) == people * PER_PERSON
    assert (answers.lost, answers.doubled, answers.changed) == (0, 0, 0)


def test_of_two_hundred_participants_at_once_no_answer_is_lost_or_doubled(study: Path) -> None:
    answers = Answers()
    with served(study) as (address, _):
        asyncio.run(answer_all(address, 200, answers.kept))
    answers.read(study)
    check(answers, 200)


@pytest.mark.parametrize("people", [30, pytest.param(300, marks=pytest.mark.scheduled)])
def test_kills_in_the_middle_lose_nothing_that_was_acknowledged(study: Path, people: int) -> None:
    check(answer_through_kills(study, people, [0.1, 0.3, 0.6]), people)


def test_what_is_lost_doubled_or_changed_is_counted() -> None:
    kept = {("a", 0): True, ("a", 1): True, ("b", 0): False}
    answers = Answers(kept, [("a", 0, False), ("b", 0, False), ("b", 0, False)], 2)
    assert (answers.lost, answers.doubled, answers.changed) == (3, 1, 1)


@pytest.mark.scheduled
@pytest.mark.parametrize("name", ATTACKS)
def test_while_one_client_attacks_another_takes_part(study: Path, name: str) -> None:
    raise_file_limit(2000)
    assert kept_out(study, ATTACKS[name], seconds=5.0) > 0  # it came to an end
