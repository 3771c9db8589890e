"""Truth: which of a few written-out numbers is best, told by eye."""

import pytest

from pacmo_core.figures.tables import (
    Cell,
    difference_table,
    insensitive_metrics,
    markdown_table,
    metrics_table,
    sensitivity_table,
    undecided_metrics,
)
from tests.figures.samples import cell


def marks(metric: str, **rows: Cell) -> dict[str, str]:
    shown = metrics_table({name: {metric: value} for name, value in rows.items()})
    return {line.label: line.entries[0].mark for line in shown.lines if line.entries[0].mark}


def test_the_lowest_model_is_best_and_references_are_never_marked() -> None:
    found = marks("f2id", real=cell(0.01), oracle=cell(0.02), pacmo=cell(0.2), gru=cell(0.5))
    assert found == {"PaCMO": "best"}


def test_a_model_whose_interval_meets_the_best_is_level() -> None:
    found = marks("ape", pacmo=cell(0.20, 0.02), gru=cell(0.23, 0.02), third=cell(0.9, 0.02))
    assert found == {"PaCMO": "best", "GRU": "level"}


def test_diversity_is_best_where_closest_to_real_motion() -> None:
    found = marks("diversity", real=cell(10), pacmo=cell(12), gru=cell(3))
    assert found == {"PaCMO": "best"}


def test_matching_is_best_where_highest() -> None:
    assert marks("matching", pacmo=cell(0.6), gru=cell(0.9)) == {"GRU": "best"}


@pytest.mark.parametrize(
    ("metric", "rows"),
    [
        ("f2id", {"real": cell(1), "pacmo": cell(2)}),
        ("unheard_of", {"pacmo": cell(1), "gru": cell(2)}),
        ("diversity", {"pacmo": cell(1), "gru": cell(2)}),
    ],
    ids=["no rival", "unknown direction", "nothing real to be close to"],
)
def test_nothing_is_marked_without_grounds(metric: str, rows: dict[str, Cell]) -> None:
    assert marks(metric, **rows) == {}


def test_a_missing_value_is_a_dash_with_its_reason_and_never_best() -> None:
    missing: Cell = {"mean": None, "missing": "diverged"}
    shown = metrics_table(
        {"gru": {"ape": missing}, "pacmo": {"ape": {"mean": float("nan")}, "f2id": cell(1)}}
    )
    pacmo, gru = shown.lines
    assert [entry.value for entry in gru.entries] == ["–", "–"]
    assert shown.reasons == ["not computed for this row", "diverged"]
    assert {entry.mark for line in (pacmo, gru) for entry in line.entries} == {""}


def test_known_rows_and_metrics_come_first_in_one_order() -> None:
    shown = metrics_table({"mine": {"x": cell(1), "ape": cell(1)}, "real": {"f2id": cell(1)}})
    assert [line.label for line in shown.lines] == ["Real motion", "mine"]
    assert [metric.label for metric in shown.metrics] == ["F²ID", "APE", "x"]


def test_markdown_has_one_line_a_row_and_marks_the_best() -> None:
    rows = {"pacmo": {"ape": cell(0.2)}, "gru": {"ape": cell(0.3)}, "a|b": {}}
    assert markdown_table(rows).splitlines() == [
        "|  | APE ↓ |",
        "| --- | ---: |",
        "| PaCMO | **0.200** (0.190 to 0.210) |",
        "| GRU | 0.300 (0.290 to 0.310) |",
        r"| a\|b | – |",
    ]


def test_of_equal_models_none_is_the_best() -> None:
    assert marks("f2id", pacmo=cell(0.2), gru=cell(0.2)) == {}
    found = marks("f2id", pacmo=cell(0.2), regression=cell(0.2), gru=cell(0.5))
    assert found == {"PaCMO": "level", "Regression": "level"}


def test_a_metric_without_a_label_is_in_no_transposed_table() -> None:
    cells = {"f2id": {**cell(1), "sensitive": True}, "diversity_l2": {**cell(1), "sensitive": True}}
    for table in (
        difference_table({"pacmo_minus_gru": cells}),
        sensitivity_table({"any_action": cells}, {}),
    ):
        assert [line.label for line in table.lines] == ["F²ID ↓"]


def test_a_metric_of_one_action_is_headed_by_the_action():
    rows = {
        "pacmo": {"contacts_met.hug": cell(0.9, 0.01)},
        "gru": {"contacts_met.hug": cell(0.2, 0.01)},
    }
    shown = metrics_table(rows)
    assert [metric.label for metric in shown.metrics] == ["hug"]
    assert [line.entries[0].mark for line in shown.lines] == ["best", ""]


def test_nothing_is_marked_or_called_insensitive_without_an_interval() -> None:
    found = metrics_table({"gru": {"ape": {"mean": 2.0}}, "pacmo": {"ape": {"mean": 1.0}}})
    assert [line.entries[0].mark for line in found.lines] == ["", ""]
    assert [line.entries[0].interval for line in found.lines] == ["", ""]
    cells = {"f2id": {"mean": 1.0, "sensitive": False}, "ape": {**cell(0), "sensitive": False}}
    assert insensitive_metrics(cells) == ["APE"]
    assert undecided_metrics(cells) == ["F²ID"]


def test_columns_with_one_meaning_say_it_once() -> None:
    columns = ("contacts_met.kick", "contacts_met.hug", "ape")
    meanings = metrics_table({"pacmo": dict.fromkeys(columns, cell(0.5))}).meanings
    assert len(meanings) == 2
    assert sorted(len(labels.split(", ")) for labels in meanings.values()) == [1, 2]
