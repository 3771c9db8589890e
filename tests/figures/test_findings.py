"""Truth: figures from which every outcome follows by eye; what a sentence claims is read off it."""

import re
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pacmo_core.figures.findings import (
    COMPARED,
    comparison_clause,
    comparison_note,
    finish_note,
    prior_findings,
    reaction_findings,
    variation_findings,
)
from pacmo_core.figures.tables import BETTER, OPEN, WORSE
from pacmo_core.metrics.catalogue import HEADLINE_MODELS, METRICS, improvement_sign
from tests.figures.samples import cell

N = len(COMPARED)
LABELS = {name: METRICS[name].label.replace(", ", " of ") for name in COMPARED}


def difference(outcome: str, metric: str) -> dict[str, Any]:
    """Return a difference whose interval shows an outcome for the first model."""
    return dict(cell({BETTER: 1.0, WORSE: -1.0, OPEN: 0.0}[outcome] * improvement_sign(metric)))


def pooled(**outcomes: dict[str, str]) -> dict[str, Any]:
    """Return pooled scores of all models, with outcomes by pair and metric."""
    return {
        "rows": {
            name: {"f2id": cell(0.2), "f2id_floor": cell(0.1)}
            for name in ("real", *HEADLINE_MODELS)
        },
        "differences": {
            pair: {metric: difference(o, metric) for metric, o in by_metric.items()}
            for pair, by_metric in outcomes.items()
        },
        "sensitivity": {},
        "confidence": 0.95,
        "folds": ["1", "2"],
        "seeds": {"pacmo": [1, 2, 3], "real": [0]},
        "test_reactions": 1234,
    }


def sentence(found: list[Any], subject: str) -> str:
    (text,) = [
        f"{finding.subject} {finding.text}" for finding in found if finding.subject == subject
    ]
    return text


def everywhere(outcome: str) -> dict[str, str]:
    return dict.fromkeys(COMPARED, outcome)


def test_every_model_has_one_sentence() -> None:
    found = reaction_findings(pooled())
    subjects = ["PaCMO", "PaCMO, augmented", "PaCMO, as in the paper", "Regression", "GRU"]
    subjects.append("Flow matching")
    assert [finding.subject for finding in found] == subjects
    assert all(finding.text.endswith(".") and "\n" not in finding.text for finding in found)


@pytest.mark.parametrize("outcome", [WORSE, OPEN])
def test_a_model_that_does_not_beat_regression_says_so(outcome: str) -> None:
    text = sentence(reaction_findings(pooled(pacmo_minus_regression=everywhere(outcome))), "PaCMO")
    assert text.startswith("PaCMO does not beat Regression: ")
    assert "is better" not in text


def test_a_nearest_neighbour_is_a_baseline_where_there_is_one() -> None:
    scores = pooled(pacmo_minus_nearest_neighbour=everywhere(WORSE))
    assert "Nearest neighbour" not in sentence(reaction_findings(scores), "PaCMO")
    scores["rows"]["nearest_neighbour"] = {}
    text = sentence(reaction_findings(scores), "PaCMO")
    assert text.startswith(f"PaCMO does not beat Nearest neighbour: better in none of {N} metrics")


def test_what_was_not_compared_is_not_praised() -> None:
    text = sentence(reaction_findings(pooled()), "PaCMO")
    assert text.startswith("PaCMO was not compared with Regression; it was not compared with GRU")


def test_a_difference_counts_for_the_second_model_the_other_way_round() -> None:
    found = reaction_findings(pooled(regression_minus_gru=everywhere(BETTER)))
    assert sentence(found, "Regression").startswith(f"Regression is better than GRU in {N} of {N}")
    assert sentence(found, "GRU").startswith(f"GRU does not beat Regression: better in none of {N}")


@given(st.lists(st.sampled_from([BETTER, WORSE, OPEN]), min_size=N, max_size=N))
def test_a_clause_claims_what_the_intervals_show_and_nothing_else(outcomes: list[str]) -> None:
    verdicts = dict(zip(COMPARED, outcomes, strict=True))
    text = comparison_clause("Regression", verdicts)
    better, worse = (outcomes.count(wanted) for wanted in (BETTER, WORSE))
    assert ("does not beat" in text) == (better == 0)
    if better:
        assert f"is better than Regression in {better} of {N} metrics" in text
    assert (f"worse in {worse} (" in text) == (worse > 0)
    for wanted, pattern in (
        (BETTER, rf"{N} metrics \((.*?)\)"),
        (WORSE, r"worse in \d+ \((.*?)\)"),
    ):
        listed = match[1].split(", ") if (match := re.search(pattern, text)) else []
        assert listed == [LABELS[name] for name in COMPARED if verdicts[name] == wanted]


@pytest.mark.parametrize("swap", [False, True])
@pytest.mark.parametrize("outcome", [BETTER, WORSE, OPEN])
def test_no_sentence_depends_on_which_model_is_ours(outcome: str, *, swap: bool) -> None:
    first, second = ("pacmo_paper", "gru") if swap else ("pacmo", "gru")
    found = reaction_findings(pooled(**{f"{first}_minus_{second}": everywhere(outcome)}))
    others = reaction_findings(pooled(pacmo_augmented_minus_gru=everywhere(outcome)))
    label = "PaCMO, as in the paper" if swap else "PaCMO"
    text = sentence(found, label).removeprefix(label)
    assert text == sentence(others, "PaCMO, augmented").removeprefix("PaCMO, augmented")


@pytest.mark.parametrize(
    ("matching", "words"),
    [
        (cell(0.5), "its reactions fit their own partner better than another one"),
        (cell(-0.5), "its reactions fit another partner better than their own"),
        (cell(0.0), "that its reactions depend on the partner is not shown"),
        ({}, "was not measured"),
    ],
)
def test_dependence_on_the_partner_is_stated_as_the_interval_has_it(
    matching: dict[str, float], words: str
) -> None:
    scores = pooled()
    scores["sensitivity"] = {"pacmo_any_action": {"matching": matching}}
    found = reaction_findings(scores)
    assert words in sentence(found, "PaCMO")
    assert "partner" not in sentence(found, "Regression")


def test_the_note_states_confidence_data_and_noise_floor() -> None:
    text = comparison_note(0.95, pooled())
    for words in ("95 % interval", "about 5 do so", "1,234 reactions", "2 folds", "3 seeds"):
        assert words in text
    assert text.startswith("Compared: F²ID, ") and "APE of joints" in text
    assert text.endswith("with other partners, is at 0.100 (0.0900 to 0.110).")


def test_a_missing_value_makes_no_claim() -> None:
    scores = pooled(pacmo_minus_gru={})
    scores["differences"]["pacmo_minus_gru"] = {"f2id": {"missing": "diverged"}}
    scores["rows"]["pacmo"] = {"f2id": {"mean": float("nan")}}
    text = sentence(reaction_findings(scores), "PaCMO")
    assert "was not compared with GRU" in text
    assert "F²ID" not in text


FACTS = {"planned": 64, "clips": 4, "accepted": 48, "failed": 0, "refused": 0, "failed_by": {}}


def test_variations_are_counted_with_the_most_frequent_fault() -> None:
    (whole,) = variation_findings({"default": FACTS | {"accepted": 64}})
    assert whole.text == "was asked for 64 variations of default: 64 are within all limits."
    failed = {"accepted": 10, "failed": 50, "refused": 4}
    reasons = {"failed_by": {"knee_flips": 3, "below_floor": 47}}
    (some,) = variation_findings({"default": FACTS | failed | reasons})
    assert "10 are within all limits, 50 are beyond one" in some.text
    assert "(most often by below the floor), 4 are of clips that it refused." in some.text


def prior_scores(**means: float) -> dict[str, Any]:
    """Return scores of one metric and split; a negative mean stands for one without interval."""
    models = {
        model: {"JPD": {"mean": -mean} if mean < 0 else dict(cell(mean, 0.1))}
        for model, mean in means.items()
    }
    return {"retargeting": {"random": models}, "generation": {}}


def test_a_skeleton_prior_is_the_lowest_only_if_it_is() -> None:
    found = prior_findings(prior_scores(kinematic=1.0, f_cnn=2.0), "default")
    assert [f.subject for f in found] == ["Skeleton prior “Ours”", "Other skeleton priors"]
    assert (
        "in 1 of 1 comparison on default; in 1 its interval over motions and seeds" in found[0].text
    )
    assert found[1].text.endswith("in no comparison on default: “F-CNN”.")


def test_a_skeleton_prior_within_the_interval_of_another_is_not_certain() -> None:
    first, _ = prior_findings(prior_scores(kinematic=1.0, f_cnn=1.1), "default")
    assert "in 1 of 1 comparison on default; in 0 its interval" in first.text


def test_equal_skeleton_priors_are_not_the_lowest() -> None:
    (finding,) = prior_findings(prior_scores(kinematic=1.0, f_cnn=1.0), "default")
    assert finding.subject == "Skeleton priors"
    assert finding.text.endswith("in no comparison on default: “Ours”, “F-CNN”.")


def test_one_training_makes_no_difference_certain() -> None:
    first, _ = prior_findings(prior_scores(kinematic=-1.0, f_cnn=-2.0), "default")
    assert "each of one motion and one seed only, so that no difference is certain" in first.text


def test_only_the_comparisons_of_one_motion_and_one_seed_are_said_to_have_no_interval() -> None:
    scores = prior_scores(kinematic=1.0, f_cnn=2.0)
    one = prior_scores(kinematic=-1.0, f_cnn=-2.0)["retargeting"]["random"]
    scores["retargeting"]["cross_interaction"] = one
    first, last = prior_findings(scores, "default")
    assert first.text == (
        "has the lowest value of all models in 2 of 2 comparisons on default; in 1 its interval "
        "over motions and seeds lies below all others; 1 of the 2 are of one motion and one seed, "
        "without interval."
    )
    assert last.text.endswith("in no comparison on default: “F-CNN”.")


def test_a_single_skeleton_prior_has_nothing_to_be_compared_with() -> None:
    assert prior_findings(prior_scores(kinematic=1.0), "default") == []


def test_bone_lengths_that_are_exact_by_construction_are_no_comparison() -> None:
    scores = prior_scores(kinematic=1.0, f_cnn=2.0)
    for model, mean in (("kinematic", 0.0), ("f_cnn", 1.0)):
        for part in ("E_b_first", "E_b_second"):
            scores["retargeting"]["random"][model][part] = dict(cell(mean, 0.1))
    first, _ = prior_findings(scores, "default")
    assert "of 1 comparison on default" in first.text


def test_a_difference_without_interval_has_too_few_units_for_a_verdict() -> None:
    scores = pooled(pacmo_minus_gru=everywhere(BETTER), pacmo_minus_regression=everywhere(BETTER))
    few = {
        name: {"mean": c["mean"]} for name, c in scores["differences"]["pacmo_minus_gru"].items()
    }
    scores["differences"]["pacmo_minus_gru"] = few
    scores["differences"]["pacmo_minus_regression"]["f2id_excess"] = {"mean": -1.0}
    scores["sensitivity"] = {"pacmo_any_action": {"matching": {"mean": 0.5, "sensitive": False}}}
    text = sentence(reaction_findings(scores), "PaCMO")
    assert (
        f"whether it beats GRU is not decided: too few units are tested for an interval of {N} "
        "metrics"
    ) in text
    assert f"is better than Regression in {N - 1} of {N - 1} metrics" in text
    assert "and too few units are tested for an interval of 1 metric;" in text
    assert "whether its reactions depend on the partner is not decided" in text


def test_a_finished_model_that_is_compared_with_unfinished_ones_says_so() -> None:
    found = reaction_findings(pooled(), ["pacmo", "pacmo_augmented"])
    ours = "its reactions are finished, those of Regression, GRU and Flow matching are not"
    assert ours in sentence(found, "PaCMO") and ours in sentence(found, "PaCMO, augmented")
    assert "finished" not in sentence(found, "PaCMO, as in the paper")
    scores = pooled()
    scores["rows"]["no_critic"] = {}
    other = "its reactions are not finished, those of PaCMO without critic are finished"
    assert other in sentence(reaction_findings(scores, ["no_critic"]), "GRU")


def test_the_note_lists_the_finished_rows() -> None:
    rows = ["real", "gru", "pacmo", "pacmo_without_finish"]
    text = finish_note(rows, ["pacmo", "no_critic"])
    assert "are the reactions of: PaCMO. Those" in text
    assert text.endswith("is seen beside: PaCMO without finish.")
    assert "What the finish" not in finish_note(rows[:3], ["pacmo"])
    assert finish_note(rows, []) == ""
