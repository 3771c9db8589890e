"""What is trusted: tables written out by hand, and the words better and worse."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pacmo_core.promotion.gate import Gate, reasons_against

GATE = Gate(row="pacmo", metrics=("f2id", "matching", "diversity"), most_floors=2.0)


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


def test_the_first_model_is_held_to_the_floor_alone():
    assert reasons_against(table(f2id=1.0), None, GATE) == []
    (reason,) = reasons_against(table(f2id=1.01), None, GATE)
    assert reason == "F²ID 1.01 is above 2 times its floor 0.5, that is 1"


def test_a_model_as_good_as_the_current_one_may_follow_it():
    assert reasons_against(table(), table(), GATE) == []


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
    assert reasons_against(table(**change), table(), GATE) == [words]


@pytest.mark.parametrize(
    "change", [{"f2id": 0.59}, {"f2id": 0.1}, {"matching": 0.9}, {"diversity": 6.2}]
)
def test_worse_within_the_interval_or_better_is_none(change):
    assert reasons_against(table(**change), table(), GATE) == []


def test_every_reason_is_given():
    worst = table(f2id=2.0, matching=0.1, diversity=0.0)
    assert len(reasons_against(worst, table(), GATE)) == 4


def test_a_metric_that_is_new_has_nothing_to_be_worse_than():
    current = table()
    del current["pacmo"]["matching"]
    assert reasons_against(table(matching=0.0), current, GATE) == []


def test_a_candidate_without_a_metric_is_an_error():
    candidate = table()
    del candidate["pacmo"]["matching"]
    with pytest.raises(KeyError, match="matching"):
        reasons_against(candidate, table(), GATE)


@settings(derandomize=True, max_examples=50)
@given(st.floats(0.01, 0.9), st.floats(0.0, 0.9), st.floats(0.0, 10.0))
def test_a_better_model_is_never_held(f2id, less, diversity):
    better = table(f2id=f2id * (1 - less), matching=0.6 + less, diversity=diversity)
    assert reasons_against(better, table(f2id=f2id, diversity=diversity), GATE) == []
