"""Truth: cells worked out by hand, and the supplement's own text."""

from pacmo_core.figures.skeleton_prior import (
    MODELS,
    comparison_sentences,
    few_samples_table,
    gain_sentence,
    motion_table,
    plausibility_table,
    select_source,
    split_label,
)
from pacmo_core.figures.supplement_tables import (
    FEW_SAMPLES_TABLE,
    SUPPLEMENT_COLUMNS,
    SUPPLEMENT_TABLES,
)


def cell(mean: float, reach: float = 0.0) -> dict[str, float]:
    return {"mean": mean, "low": mean - reach, "high": mean + reach}


def metrics(size: float) -> dict[str, dict[str, float]]:
    names = ("E_r", "E_b", "FID")
    each = {f"{n}_{role}": cell(size, 0.001) for n in names for role in ("first", "second")}
    return {**each, "JPD": cell(size), "contacts_preserved": cell(0.9)}


SCORES = {
    task: {"random": {"kinematic": metrics(0.01), "f_cnn": metrics(0.02)}}
    for task in ("retargeting", "generation")
}


def test_the_supplements_tables_are_whole():
    assert len(SUPPLEMENT_TABLES) == 9 and len(FEW_SAMPLES_TABLE) == 2
    for motion, text in SUPPLEMENT_TABLES.items():
        rows = [line.split() for line in text.split("\n") if line.strip()]
        assert [len(row) for row in rows] == [len(SUPPLEMENT_COLUMNS)] * 24, motion
        for row in range(24):
            of_each = row // 4 not in (2, 5)
            assert all("/" in figure or figure == "-" for figure in rows[row]) == of_each
    missing = [
        figure for text in SUPPLEMENT_TABLES.values() for figure in text.split() if figure == "-"
    ]
    assert len(missing) == 19


def test_a_cell_holds_ours_in_millimetres_and_theirs_below():
    shown = motion_table(SCORES, "Judo")
    assert [m.label for m in shown.metrics] == [m.label for m in MODELS.values()]
    first = shown.lines[0]
    assert (first.label, first.meaning) == ("E_r, retargeting, mm", "Random")
    cells = dict(zip(MODELS, first.entries, strict=True))
    ours, f_cnn = cells["kinematic"], cells["f_cnn"]
    assert ours.value == "10.0/10.0" and ours.mark == "best"
    assert ours.interval.splitlines() == ["9.00 to 11.0"] * 2  # theirs stands at the paper's form
    assert f_cnn.interval.endswith("supplement 0.673/2.569") and not f_cnn.mark
    assert cells["paper"].value == "–"  # a model that was not trained
    bones = next(line for line in shown.lines if line.label.startswith("E_b"))
    assert not any(entry.mark for entry in bones.entries)  # zero by construction
    assert {line.meaning for line in shown.lines} == {"Random"} and len(shown.lines) == 6


def test_table_ten_holds_the_best_baseline_and_the_numbers_of_samples_that_were_run():
    shown = few_samples_table(
        {task: {"cross_scale_interaction_6": SCORES[task]["random"]} for task in SCORES}
    )
    by_name = {(line.label, line.meaning): line.entries for line in shown.lines}
    assert by_name["Ours", "6 samples"][0].value == "10.0"
    assert by_name["Best baseline", "6 samples"][0].value == "20.0"
    assert ("Ours", "24 samples") not in by_name
    assert by_name["Supplement, Big-ben", "6 samples"][0].value == "6.254"


def test_verdicts_count_the_splits_that_ours_wins():
    said = list(comparison_sentences(SCORES))
    assert len(said) == 4 and all("1 of 1" in line for line in said)
    beaten = {
        task: {"random": {**splits["random"], "start": metrics(0.005)}}
        for task, splits in SCORES.items()
    }
    assert all("0 of 1" in line for line in comparison_sentences(beaten))
    table = plausibility_table(SCORES)
    assert len(table.lines) == 2 and table.lines[0].entries[0].value == "0.900"


def test_of_equal_models_none_is_marked_and_ours_has_not_won():
    scores = {"retargeting": {"random": {"kinematic": metrics(0.01), "f_cnn": metrics(0.01)}}}
    assert all("in 0 of 1 splits" in line for line in comparison_sentences(scores))
    marks = {entry.mark for line in motion_table(scores, "Judo").lines for entry in line.entries}
    assert marks == {""}


def test_splits_are_named_in_words():
    assert split_label("cross_scale_interaction_6") == "Cross-scale-interaction, 6 training samples"
    assert split_label("random") == "Random"


def test_the_gain_of_training_is_said_with_its_units_whichever_way_it_came_out():
    gain = {
        "motions": 4,
        "seeds": 1,
        "E_r": {"mean": 0.123, "low": -0.05, "high": 0.3},
        "JPD": {"mean": -0.2, "low": -0.5, "high": 0.1},
    }
    assert gain_sentence("random", gain) == (
        "What training adds to the start, Random: E_r falls by 12% (-5 to 30 %) and JPD rises by "
        "20% (-10 to 50 %) (over 4 motions and 1 seed, fewer than 10 units)"
    )
    alone = {"motions": 1, "seeds": 1, "E_r": {"mean": 0.1}, "JPD": {"mean": 0.1}}
    assert "E_r falls by 10% and JPD falls by 10% (over 1 motion and" in gain_sentence("x", alone)
    none = alone | {"E_r": {"mean": 0.0}, "JPD": {"mean": 0.0}}
    assert "x: nothing, as no epoch has a lower validation error" in gain_sentence("x", none)


def test_a_sources_figures_leave_out_models_without_it():
    scores = {"retargeting": {"f": {"random": {"kinematic": {"s": metrics(1)}, "f_cnn": {}}}}}
    found = select_source(scores, "f", "s")
    assert found["retargeting"]["random"].keys() == {"kinematic"}
