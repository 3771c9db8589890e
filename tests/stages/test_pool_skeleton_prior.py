"""Truth: Student's interval by hand; names taken apart by eye; sides that are known."""

from argparse import Namespace
from pathlib import Path

import numpy as np
import pytest
from ruamel.yaml import YAML

from pacmo_core.data.variation_splits import VariationScales
from pacmo_core.store.tables import VARIATIONS
from stages import split_variations
from stages.common.params import PriorRuns, StageError, parse_split_name
from stages.pool_skeleton_prior import (
    folds_of_groups,
    gain_over_start,
    interval,
    join_folds,
    over_units,
)


@pytest.mark.parametrize(
    ("name", "wanted"),
    [
        ("random", ("random", None, None, "random")),
        ("cross_scale", ("cross_scale", None, None, "cross_scale")),
        ("cross_scale_24", ("cross_scale", None, 24, "cross_scale_24")),
        ("cross_scale_fold2", ("cross_scale", 2, None, "cross_scale")),
        (
            "cross_scale_interaction_fold3_6",
            ("cross_scale_interaction", 3, 6, "cross_scale_interaction_6"),
        ),
    ],
)
def test_a_splits_name_says_its_fold_and_how_many_train(name, wanted):
    found = parse_split_name(name)
    assert (found.kind, found.fold, found.samples, found.pooled) == wanted


def test_every_source_is_held_out_in_one_fold():
    sources = [f"clip{number}" for number in range(7)]
    params = split_variations.Params((), 3, (), 0.2, 0.0, 1)
    folds = [split_variations.held_out_sources(sources, fold, params) for fold in (1, 2, 3)]
    assert sorted(name for fold in folds for name in fold) == sources
    assert [len(fold) for fold in folds] == [3, 2, 2]
    with pytest.raises(ValueError, match="fold must be 1 to n_folds, 3; got 4"):
        split_variations.held_out_sources(sources, 4, params)


def test_folds_that_are_listed_test_what_their_patterns_match():
    sources = ["a/01/1", "a/02/1", "b/01/1", "b/03/1"]
    listed = (("*/01/*",), ("*/02/*", "*/03/*"))
    params = split_variations.Params(("*/01/*",), 3, listed, 0.2, 0.0, 1)
    first, second = (split_variations.held_out_sources(sources, f, params) for f in (1, 2))
    assert first == {"a/01/1", "b/01/1"} and second == {"a/02/1", "b/03/1"}
    with pytest.raises(ValueError, match="fold must be 1 to the number of folds, 2; got 3"):
        split_variations.held_out_sources(sources, 3, params)


def test_folds_of_a_split_that_holds_out_no_source_are_refused():
    facts = {"one~0": VariationScales("one", np.ones((2, 3)))}
    params = split_variations.Params((), 3, (), 0.2, 0.0, 1)
    with pytest.raises(ValueError, match="folds are of the splits cross_interaction and"):
        split_variations.assign(facts, "random_fold1", params)


def test_folds_are_pooled_over_their_motions():
    def scores(source, error, train):
        task = {source: {"E_r": error}, "all": {"E_r": error}}
        return {
            "extractor": "x",
            "bodies": {},
            "train": train,
            "tested": 4,
            "weights": {"kinematic": {"1": f"hash of {source}"}, "m": {"1": "other"}},
            "models": {"m": {"1": {"t": task}}},
        }

    runs = PriorRuns(["a"], ["x_fold1", "x_fold2", "y"], [], [])
    assert folds_of_groups(runs) == {("a", "x"): ["x_fold1", "x_fold2"], ("a", "y"): ["y"]}
    joined = join_folds([scores("s", 1.0, 10), scores("t", 5.0, 12)])
    assert (joined["train"], joined["tested"]) == (11, 8)
    assert joined["weights"] == ["hash of s", "hash of t"]
    assert over_units([joined["models"]["m"]["1"]["t"]], 0.9)["all"]["E_r"]["mean"] == 3.0


def test_each_family_meets_each_split():
    priors = PriorRuns(["a", "b"], ["x", "y"], [], [])
    assert list(priors.groups()) == [("a", "x"), ("a", "y"), ("b", "x"), ("b", "y")]


def test_an_interval_over_three_seeds_is_students():
    found = interval(np.array([[1.0, 2.0, 3.0]]), 0.95)
    reach = 4.302653 / 3**0.5  # the table's t of two degrees of freedom, deviation 1
    assert found["mean"] == 2.0
    assert found["high"] - 2 == pytest.approx(reach, rel=1e-5)
    assert interval(np.array([[0.3]]), 0.95) == {"mean": 0.3}


def test_an_interval_over_motions_and_seeds_adds_both_variances():
    values = np.array([[0.0, 2.0, 4.0], [6.0, 8.0, 10.0]])  # two motions, three seeds
    found = interval(values, 0.95)
    variance = 18 / 2 + 4 / 3  # of the means 2 and 8; of the means 3, 5 and 7
    assert found["mean"] == 5.0
    assert found["high"] - 5 == pytest.approx(12.7062 * variance**0.5, rel=1e-5)  # t of one degree
    assert interval(values[:, :1], 0.95)["high"] - 3 == pytest.approx(12.7062 * 3, rel=1e-5)


def test_scores_are_pooled_motion_by_motion_and_over_motions_that_have_them():
    seeds = [
        {"s": {"E_r": first}, "t": {"E_r": 5.0, "skate": 1.0}, "all": {"E_r": 0.0, "skate": 1.0}}
        for first in (1.0, 3.0)
    ]
    found = over_units(seeds, 0.9)
    assert found["s"]["E_r"]["mean"] == 2.0 and found["s"]["E_r"]["low"] < 2
    assert found["all"]["E_r"]["mean"] == 3.5 and found["all"]["E_r"]["low"] < 2
    assert found["all"]["skate"] == {"mean": 1.0, "low": 1.0, "high": 1.0}


def test_the_gain_is_the_share_of_the_starts_error_that_training_removes():
    def row(first, second, distance):
        return {"E_r_first": first, "E_r_second": second, "JPD": distance}

    def sampled(distance):  # the solver refused the bodies that were sampled for s
        return {"generation": {"s": {"coverage": 1.0}, "t": {"JPD": distance}, "all": {"JPD": 9}}}

    start = {
        1: {"retargeting": {"s": row(1, 3, 2), "t": row(1, 1, 1), "all": row(9, 9, 9)}}
        | sampled(4.0)
    }
    trained = {
        seed: {"retargeting": {"s": row(1, 1, 3), "t": row(1, 1, share), "all": row(9, 9, 9)}}
        | sampled(4 * share)
        for seed, share in ((1, 0.5), (2, 1.0))
    }
    found = gain_over_start({"start": start, "kinematic": trained}, 0.95)
    assert (found["motions"], found["seeds"]) == (2, 2)
    assert found["E_r"]["mean"] == pytest.approx(0.25)  # 50 % and nothing
    assert (found["E_r"]["start"], found["E_r"]["trained"]) == (1.5, 1.0)  # of both characters
    assert found["JPD"]["mean"] == pytest.approx((-0.5 - 0.5 + 0.5 + 0) / 4)
    assert found["JPD_sampled"]["mean"] == 0.25 and found["JPD_sampled"]["trained"] == 3.0


def test_patterns_hold_sources_out_and_numbers_keep_few():
    facts = {
        f"{source}~{k}": VariationScales(source, np.full((2, 3), scale))
        for source in ("one", "two")
        for k, scale in enumerate([0.95, 1.05, 0.9, 0.8, 1.2])
    }
    params = split_variations.Params(("tw*",), 3, (), 0.2, 0.0, 1)
    sides = split_variations.assign(facts, "cross_scale_interaction_1", params)
    assert {n for n, side in sides.items() if side == "test"} == {"two~3", "two~4"}
    train = [name for name, side in sides.items() if side == "train"]
    assert len(train) == 1 and train[0] in ("one~0", "one~1")


def refused(said, dataset, split):
    """Run the stage on the folder ``v``; it must end with a text that the pattern matches."""
    priors = {"datasets": [dataset], "splits": [split], "models": [], "seeds": []}
    section = {
        "held_out": ["*A055"],
        "n_folds": 3,
        "folds": [],
        "test_share": 0.2,
        "validation_share": 0.1,
        "random_seed": 1,
    }
    runs = {"folds": [1], "seeds": [1], "models": [], "variants": [], "priors": priors}
    YAML(typ="safe").dump({"runs": runs, "split_variations": section}, Path("params.yaml"))
    paths = Namespace(variations=Path("v"), splits=Path("s"), metrics=Path("m.json"))
    with pytest.raises(StageError, match=said):
        split_variations.main(paths)


def test_a_faulty_choice_of_datasets_or_splits_names_the_parameter(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    facts = {"one~a": VariationScales("one", np.ones((2, 3)))}
    monkeypatch.setattr(split_variations, "read_variation_facts", lambda _: facts)
    (tmp_path / "v" / "mine").mkdir(parents=True)
    (tmp_path / "v" / "mine" / VARIATIONS).touch()
    refused("runs.priors.datasets: v has no variations of default", "default", "random")
    said = r"mine: split cross_interaction: nothing to test on .*held_out is \*A055"
    refused(said, "mine", "cross_interaction")
