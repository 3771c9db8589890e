"""What is trusted: bytes that the test wrote, and what stands in a folder."""

import json
import os

import polars as pl
import pytest

from pacmo_core.promotion import shelf
from pacmo_core.promotion.history import (
    Decision,
    add_decision,
    next_number,
    read_decisions,
    write_table,
)


def decision(number, **changes):
    facts = {
        "number": number,
        "at": "2026-01-01T00:00:00+00:00",
        "verdict": "promoted",
        "reasons": (),
        "model": "00",
        "shelf": number,
        "experiment": "small",
        "test_reactions": 4,
        "metrics": {"f2id": {"mean": 0.5, "low": 0.4, "high": 0.6}},
    }
    return Decision(**{**facts, **changes})


@pytest.fixture
def weights(tmp_path):
    path = tmp_path / "weights"
    path.write_bytes(b"one")
    return path


def test_what_is_put_on_the_shelf_is_a_copy_that_edits_do_not_reach(tmp_path, weights):
    shelf.put(tmp_path / "shelf", 3, {"models/w": weights})
    weights.write_bytes(b"two")
    assert (tmp_path / "shelf/000003/models/w").read_bytes() == b"one"
    assert shelf.numbers(tmp_path / "shelf") == [3]


def test_nothing_on_the_shelf_is_written_twice(tmp_path, weights):
    shelf.put(tmp_path / "shelf", 3, {"w": weights})
    with pytest.raises(FileExistsError, match="stays as it is"):
        shelf.put(tmp_path / "shelf", 3, {"w": weights})


def test_what_a_killed_run_left_half_copied_is_no_model(tmp_path, weights):
    (tmp_path / "shelf/.000003").mkdir(parents=True)
    (tmp_path / "shelf/.000003/other").write_bytes(b"half")
    assert shelf.numbers(tmp_path / "shelf") == []
    place = shelf.put(tmp_path / "shelf", 3, {"w": weights})
    assert [path.name for path in place.iterdir()] == ["w"]


def test_current_is_one_of_the_shelf_and_can_go_back(tmp_path, weights):
    place = tmp_path / "shelf"
    assert shelf.current(place) == 0
    for number in (1, 2):
        weights.write_bytes(bytes([number]))
        shelf.put(place, number, {"w": weights})
        shelf.make_current(place, number)
        assert (place / "current/w").read_bytes() == bytes([number])
    shelf.make_current(place, 1)
    assert (shelf.current(place), (place / "current/w").read_bytes()) == (1, b"\1")
    with pytest.raises(FileNotFoundError, match=r"holds no 000007; it holds \[1, 2\]"):
        shelf.make_current(place, 7)
    with pytest.raises(ValueError, match="is current"):
        shelf.remove(place, 1)


def test_decisions_come_back_in_the_order_of_their_numbers_whatever_the_clock_says(tmp_path):
    late, early = decision(1, at="2030-01-01T00:00:00+00:00"), decision(2, at="1999-01-01")
    add_decision(tmp_path, late)
    add_decision(tmp_path, early)
    assert read_decisions(tmp_path) == ([late, early], [])
    assert next_number(tmp_path) == 3


def test_the_table_has_a_row_a_decision_with_its_reasons_and_metrics(tmp_path):
    add_decision(tmp_path, decision(1))
    add_decision(tmp_path, decision(2, verdict="held", reasons=("worse", "and worse"), shelf=1))
    rows = pl.read_parquet(tmp_path / "decisions.parquet")
    assert rows["verdict"].to_list() == ["promoted", "held"]
    assert rows["reasons"].to_list() == [[], ["worse", "and worse"]]
    assert rows["metrics"][0][0] == {"metric": "f2id", "mean": 0.5, "low": 0.4, "high": 0.6}


def test_a_broken_table_is_made_again_from_the_decisions(tmp_path):
    add_decision(tmp_path, decision(1))
    table = tmp_path / "decisions.parquet"
    whole = table.read_bytes()
    table.write_bytes(whole[: len(whole) // 2])
    write_table(tmp_path)
    assert table.read_bytes() == whole


def test_a_broken_decision_is_named_and_the_others_are_read(tmp_path):
    for number in (1, 2):
        add_decision(tmp_path, decision(number))
    (tmp_path / "000001.json").write_text(json.dumps({"number": 1})[:-1])
    found, broken = read_decisions(tmp_path)
    assert [d.number for d in found] == [2]
    assert [fault.file.name for fault in broken] == ["000001.json"]
    assert next_number(tmp_path) == 3


def test_a_decision_is_written_once(tmp_path):
    add_decision(tmp_path, decision(1))
    with pytest.raises(FileExistsError, match="written once"):
        add_decision(tmp_path, decision(1))


def test_a_hash_is_of_content_in_order(tmp_path):
    one, two = tmp_path / "1", tmp_path / "2"
    one.write_bytes(b"1")
    two.write_bytes(b"2")
    assert shelf.model_hash([one, two]) != shelf.model_hash([two, one])
    os.utime(one, (0, 0))
    assert len(shelf.model_hash([one])) == 64
    with pytest.raises(ValueError, match="got none"):
        shelf.model_hash([])
