"""What is trusted: the bytes dropped into the inbox; nothing of them may be lost or overwritten."""

import shutil
from pathlib import Path

import pytest

import flows.inbox as moves
from flows.inbox import Move, finish_moves, move_captures

FILES = {"a/1.asf": b"body", "a/1.amc": b"first", "a/2.amc": b"second"}
# Two captures share the file of a body; one is good, one is not.
MOVES = [
    Move("one", ("a/1.amc", "a/1.asf"), "raw"),
    Move("two", ("a/2.amc", "a/1.asf"), "aside/two", "it is empty", 3),
]


class KilledError(Exception):
    """Stands for kill -9: nothing of the code under test may catch it."""


@pytest.fixture
def inbox(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    drop()
    return Path("inbox")


def drop():
    for name, data in FILES.items():
        path = Path("inbox") / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)


def placed(folder):
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in Path(folder).rglob("*")
        if path.is_file()
    }


def assert_all_moved():
    assert placed("raw") == {name: FILES[name] for name in ("a/1.amc", "a/1.asf")}
    aside = placed("aside/two")
    assert b"it is empty" in aside.pop("reason.json")
    assert aside == {name: FILES[name] for name in ("a/2.amc", "a/1.asf")}
    assert placed("inbox") == {} and not Path("plan.json").exists()


def test_good_captures_go_in_and_others_aside_with_the_reason(inbox):
    move_captures(inbox, MOVES, Path("plan.json"))
    assert_all_moved()
    assert list(inbox.iterdir()) == []


@pytest.mark.parametrize("step", range(12))
def test_killed_at_any_step_the_next_run_finishes_and_loses_nothing(inbox, monkeypatch, step):
    left = [step]

    def counted(do):
        def one(*arguments, **options):
            left[0] -= 1
            if left[0] < 0:
                raise KilledError
            return do(*arguments, **options)

        return one

    with monkeypatch.context() as patch:
        patch.setattr(moves.shutil, "copyfile", counted(shutil.copyfile))
        patch.setattr(moves, "write_text", counted(moves.write_text))
        patch.setattr(Path, "unlink", counted(Path.unlink))
        try:
            move_captures(inbox, MOVES, Path("plan.json"))
        except KilledError:
            everywhere = {**placed("inbox"), **placed("aside"), **placed("raw")}
            assert set(FILES.values()) <= set(everywhere.values())
    if not Path("plan.json").exists() and placed("inbox"):
        move_captures(inbox, MOVES, Path("plan.json"))  # it had not begun
    finish_moves(inbox, Path("plan.json"))
    assert_all_moved()


def test_a_place_that_holds_something_else_is_never_overwritten(inbox):
    Path("raw/a").mkdir(parents=True)
    Path("raw/a/1.amc").write_bytes(b"older")
    with pytest.raises(FileExistsError, match="with other content"):
        move_captures(inbox, MOVES, Path("plan.json"))
    assert placed("inbox") == FILES
    assert Path("raw/a/1.amc").read_bytes() == b"older"


def test_without_a_plan_there_is_nothing_to_finish(inbox):
    assert finish_moves(inbox, Path("plan.json")) == []
    assert placed("inbox") == FILES
