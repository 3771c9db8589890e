"""What is trusted: tables and bytes that the test wrote."""

import json
import os

import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pacmo_core import promotion
from pacmo_core.promotion import (
    Decision,
    Gate,
    add_decision,
    check_gate,
    next_number,
    read_decisions,
    write_table,
)

GATE = Gate(row="pacmo", metrics=("f2id", "matching", "diversity"), max_noise_floor_ratio=2.0)


def cell(mean, reach=0.1):
    return {"mean": mean, "low": mean - reach, "high": mean + reach}


def table(f2id=0.5, matching=0.6, diversity=6.0, floor=0.5, real=6.2):
    return {
        "pacmo": {
            "f2id": cell(f2id),
            "matching": cell(matching),
            "diversity": cell(diversity),
            "f2id_floor": cell(floor),
        },
        "real": {"diversity": cell(real)},
    }


def test_the_first_model_is_compared_with_the_noise_floor_alone():
    assert check_gate(table(f2id=1.0), None, GATE) == []
    (reason,) = check_gate(table(f2id=1.01), None, GATE)
    assert reason == "F²ID 1.01 is above 2 times its noise floor 0.5, that is 1"


def test_a_model_as_good_as_the_current_one_may_follow_it():
    assert check_gate(table(), table(), GATE) == []


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"f2id": 0.61}, "F²ID rose to 0.61; current 0.5 (0.4 to 0.6)"),
        ({"matching": 0.49}, "Matching fell to 0.49; current 0.6 (0.5 to 0.7)"),
        ({"diversity": 5.88}, "Diversity is 0.32 from real motion's; current 0.2 ± 0.1"),
        ({"diversity": 6.52}, "Diversity is 0.32 from real motion's; current 0.2 ± 0.1"),
    ],
)
def test_a_metric_worse_by_more_than_its_interval_is_a_reason(change, words):
    assert check_gate(table(**change), table(), GATE) == [words]


@pytest.mark.parametrize(
    "change", [{"f2id": 0.59}, {"f2id": 0.1}, {"matching": 0.9}, {"diversity": 6.2}]
)
def test_worse_within_the_interval_or_better_is_none(change):
    assert check_gate(table(**change), table(), GATE) == []


def test_every_reason_is_given():
    worst = table(f2id=2.0, matching=0.1, diversity=0.0)
    assert len(check_gate(worst, table(), GATE)) == 4


def test_a_metric_that_is_new_has_nothing_to_be_worse_than():
    current = table()
    del current["pacmo"]["matching"]
    assert check_gate(table(matching=0.0), current, GATE) == []


def test_without_real_motion_of_the_current_model_distances_from_it_are_not_compared():
    current = table()
    del current["real"]
    assert check_gate(table(diversity=9.0), current, GATE) == []


def test_a_candidate_without_a_metric_is_held():
    candidate = table()
    del candidate["pacmo"]["matching"]
    assert check_gate(candidate, table(), GATE) == ["Matching of pacmo is missing"]
    assert "is missing" in check_gate({}, table(), GATE)[0]
    assert "matching" not in promotion.compared_metrics(candidate, GATE)
    assert check_gate(candidate, candidate, GATE) == []  # captures without contact, say


@settings(derandomize=True, max_examples=50)
@given(st.floats(0.01, 0.9), st.floats(0.0, 0.9), st.floats(0.0, 10.0))
def test_a_better_model_is_never_rejected(f2id, less, diversity):
    better = table(f2id=f2id * (1 - less), matching=0.6 + less, diversity=diversity)
    assert check_gate(better, table(f2id=f2id, diversity=diversity), GATE) == []


BROKEN = [float("nan"), float("inf"), float("-inf")]


@pytest.mark.parametrize("part", ["mean", "low", "high"])
@pytest.mark.parametrize("value", BROKEN)
@pytest.mark.parametrize("metric", ["f2id", "f2id_floor", "matching", "diversity"])
def test_a_metric_that_is_not_finite_is_a_reason_of_either_model(metric, value, part):
    broken = table()
    broken["pacmo"][metric][part] = value
    (reason,) = [r for r in check_gate(broken, table(), GATE) if "no finite" in r]
    assert "of pacmo is no finite interval" in reason
    assert check_gate(broken, None, GATE) == [reason]
    assert check_gate(table(), broken, GATE)[0] == f"the current model's {reason}"


def test_real_motion_that_is_not_finite_is_a_reason_where_a_metric_is_compared_with_it():
    (reason, *_) = check_gate(table(real=float("nan")), table(), GATE)
    assert reason.startswith("Diversity of real is no finite interval")


@pytest.mark.parametrize("ratio", [float("nan"), float("inf"), 0.0, -1.0])
def test_a_gate_that_would_let_everything_or_nothing_through_is_refused(ratio):
    with pytest.raises(ValueError, match="max_noise_floor_ratio must be positive"):
        Gate(row="pacmo", metrics=(), max_noise_floor_ratio=ratio)


def decision(number, **changes):
    facts = {
        "number": number,
        "at": "2026-01-01T00:00:00+00:00",
        "verdict": "promoted",
        "reasons": (),
        "model": "00",
        "current_model": number,
        "experiment": "small",
        "test_reactions": 4,
        "metrics": {"f2id": {"mean": 0.5, "low": 0.4, "high": 0.6}},
    }
    return Decision(**{**facts, **changes})


def store(models, number, files):
    """Promote a model without a decision."""
    promotion.prepare_model(models, number, files)
    promotion.publish_model(models, number)
    return models / f"{number:06d}"


@pytest.fixture
def weights(tmp_path):
    path = tmp_path / "weights"
    path.write_bytes(b"one")
    return path


def test_a_promoted_model_is_a_copy_that_edits_do_not_change(tmp_path, weights):
    store(tmp_path / "promoted", 3, {"models/w": weights})
    weights.write_bytes(b"two")
    assert (tmp_path / "promoted/000003/models/w").read_bytes() == b"one"
    assert promotion.list_models(tmp_path / "promoted") == [3]


def test_a_promoted_model_is_written_once(tmp_path, weights):
    store(tmp_path / "promoted", 3, {"w": weights})
    with pytest.raises(FileExistsError, match="written once"):
        store(tmp_path / "promoted", 3, {"w": weights})


def test_what_a_killed_run_left_half_copied_is_no_model(tmp_path, weights):
    (tmp_path / "promoted/.000003").mkdir(parents=True)
    (tmp_path / "promoted/.000003/other").write_bytes(b"half")
    assert promotion.list_models(tmp_path / "promoted") == []
    place = store(tmp_path / "promoted", 3, {"w": weights})
    assert [path.name for path in place.iterdir()] == ["w"]


def test_current_is_one_of_the_promoted_models_and_can_go_back(tmp_path, weights):
    place = tmp_path / "promoted"
    assert promotion.current_model(place) == 0
    for number in (1, 2):
        weights.write_bytes(bytes([number]))
        store(place, number, {"w": weights})
        promotion.set_current_model(place, number)
        assert (place / "current/w").read_bytes() == bytes([number])
    promotion.set_current_model(place, 1)
    assert (promotion.current_model(place), (place / "current/w").read_bytes()) == (1, b"\1")
    with pytest.raises(FileNotFoundError, match=r"no model 000007; there are \[1, 2\]"):
        promotion.set_current_model(place, 7)
    with pytest.raises(ValueError, match="is current"):
        promotion.remove_model(place, 1)


def test_decisions_come_back_in_the_order_of_their_numbers_whatever_the_clock_says(tmp_path):
    late, early = decision(1, at="2030-01-01T00:00:00+00:00"), decision(2, at="1999-01-01")
    add_decision(tmp_path, late)
    add_decision(tmp_path, early)
    assert read_decisions(tmp_path) == ([late, early], [])
    assert next_number(tmp_path) == 3


def test_the_table_has_a_row_a_decision_with_its_reasons_and_metrics(tmp_path):
    add_decision(tmp_path, decision(1))
    add_decision(
        tmp_path, decision(2, verdict="rejected", reasons=("worse", "and worse"), current_model=1)
    )
    rows = pl.read_parquet(tmp_path / "decisions.parquet")
    assert rows["verdict"].to_list() == ["promoted", "rejected"]
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
    assert promotion.model_hash([one, two]) != promotion.model_hash([two, one])
    os.utime(one, (0, 0))
    assert len(promotion.model_hash([one])) == 64
    with pytest.raises(ValueError, match="got none"):
        promotion.model_hash([])
