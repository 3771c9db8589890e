"""Truth: figures written down here, and what they say to a reader."""

import pytest

from pacmo_core.figures.tables import augmentation_table, augmentation_verdict, metric_verdict


def cell(low: float, high: float) -> dict[str, float]:
    return {"mean": (low + high) / 2, "low": low, "high": high}


def pooled(**folds: dict[str, float]) -> dict:
    rows = {name: {"mean": 1.0, "low": 0.5, "high": 1.5} for name in folds}
    return {
        **dict.fromkeys(("with", "without", "clips"), rows),
        "folds": folds,
        "each": {name: [-0.1, 0.2, -0.3] for name in folds},
    }


GOOD, BAD, OPEN = cell(-0.4, -0.1), cell(0.1, 0.4), cell(-0.1, 0.1)


@pytest.mark.parametrize(
    ("folds", "words"),
    [
        (
            {"f2id": GOOD, "ape": OPEN},
            "Augmentation improves the metrics; significantly better in F²ID; undecided in 1 of 2",
        ),
        (
            {"f2id": BAD, "ape": OPEN},
            "Augmentation worsens the metrics; significantly worse in F²ID",
        ),
        ({"f2id": GOOD, "ape": BAD}, "Augmentation improves some metrics and worsens others"),
        ({"f2id": OPEN, "ape": OPEN}, "No significant effect of augmentation; undecided in 2 of 2"),
    ],
)
def test_the_verdict_is_stated_in_either_direction(folds, words):
    assert augmentation_verdict(pooled(**folds)).startswith(words)


def test_more_of_what_is_good_is_better_and_what_has_no_direction_is_open():
    assert metric_verdict("matching", BAD) == "better"
    assert metric_verdict("matching", GOOD) == "worse"
    assert metric_verdict("diversity", GOOD) == "open"
    assert metric_verdict("f2id", {}) == "open"
    assert "diversity" not in augmentation_verdict(pooled(diversity=GOOD, f2id=OPEN)).lower()


def test_a_line_has_both_figures_both_differences_and_the_folds_won():
    table = augmentation_table(pooled(ape=GOOD, f2id=OPEN, diversity=OPEN, matching=OPEN))
    lines = {line.label: line.entries for line in table.lines}
    assert list(lines) == ["F²ID ↓", "Diversity →", "Matching ↑", "APE ↓ m"]
    assert [entry.mark for entry in lines["APE ↓ m"]] == ["", "", "", "best", ""]
    assert [lines[name][-1].value for name in ("APE ↓ m", "Matching ↑")] == ["2 of 3", "1 of 3"]
    assert "better" in lines["Diversity →"][-1].reason
    assert all(len(entries) == len(table.metrics) for entries in lines.values())


def test_one_fold_alone_decides_nothing():
    one = pooled(ape=GOOD)
    one["folds"] = {}
    assert "undecided in 1 of 1" in augmentation_verdict(one)
    assert augmentation_table(one).lines[0].entries[3].value == "–"
