"""Trusted: what pooling gives is the mean of the scores written, and differences of paired rows."""

import json

import numpy as np
import pytest

from pacmo_core.promotion import Gate, check_gate
from pacmo_core.store.scores import Score, write_scores
from stages import pool_pacmo

N = {"test_reactions": 4, "same_action_reactions": 4, "matching_candidates": 3}
VALUES = {  # fold 1 and fold 2
    ("real", 0, "f2id"): (0.3, 0.5),
    ("real", 0, "f2id_halves"): (0.8, 0.8),
    ("real_pairs", 0, "mmd_pair"): (0.1, 0.1),
    ("wrong_partner", 0, "mmd_pair"): (0.5, 0.3),
    ("pacmo", 1, "f2id"): (0.1, 0.2),
    ("pacmo", 2, "f2id"): (0.3, 0.4),
    ("pacmo_permuted", 1, "f2id"): (0.4, 0.5),
    ("pacmo_permuted", 2, "f2id"): (0.6, 0.7),
    ("pacmo_augmented", 1, "f2id"): (0.05, 0.1),
    ("gru", 1, "f2id"): (0.9, 1.0),
    ("gru", 1, "multimodality"): (0.9, None),
}


@pytest.fixture
def pooled(tmp_path, monkeypatch):
    (tmp_path / "params.yaml").write_text("pool_pacmo: {confidence: 0.95, random_seed: 1}\n")
    monkeypatch.chdir(tmp_path)
    for fold in (1, 2):
        noise = 0.01 * np.random.default_rng(fold).normal(size=101)
        noise[0] = 0
        scores = [
            Score(row, seed, metric, values[fold - 1] + noise)
            for (row, seed, metric), values in VALUES.items()
            if values[fold - 1] is not None
        ]
        facts = {
            "autoencoder_sha256": f"a{fold}",
            "matcher_sha256": f"m{fold}",
            "unit": "clip",
            "n": N,
        }
        write_scores(
            tmp_path / f"scores/{fold}.parquet",
            scores,
            facts | {"absent": {"gru": {"multimodality": "one reaction per partner"}}},
        )
    pool_pacmo.main(tmp_path / "scores", tmp_path / "pacmo.json")
    return json.loads((tmp_path / "pacmo.json").read_text())


def test_rows_are_means_over_seeds_and_folds_with_the_floors_beside_them(pooled):
    assert pooled["rows"]["pacmo"]["f2id"]["mean"] == pytest.approx(0.25)
    assert pooled["rows"]["pacmo"]["f2id_floor"]["mean"] == pytest.approx(0.4)
    assert pooled["seeds"] == {
        "real": [0],
        "real_pairs": [0],
        "wrong_partner": [0],
        "pacmo": [1, 2],
        "pacmo_permuted": [1, 2],
        "pacmo_augmented": [1],
        "gru": [1],
    }
    assert pooled["test_reactions"] == 8
    assert pooled["matcher_sha256"] == {"1": "m1", "2": "m2"}


def test_a_row_with_variations_in_some_folds_only_is_refused() -> None:
    row = {"f2id": {1: pool_pacmo.Estimate(0.1, np.array([0.1, 0.2]))}}
    both = {"pacmo": row, "pacmo_augmented": row}
    assert set(pool_pacmo.align_folds([both, both])) == {"pacmo", "pacmo_augmented"}
    with pytest.raises(ValueError, match=r"augmented.folds: wanted all 2 folds .* or none; got 1"):
        pool_pacmo.align_folds([both, {"pacmo": row}])


def test_a_metric_that_one_fold_is_without_is_left_out_with_the_reason(pooled):
    assert "multimodality" not in pooled["rows"]["gru"]
    assert pooled["absent"]["gru"]["multimodality"] == "one reaction per partner"


def test_differences_are_paired_where_rows_share_draws(pooled):
    found = pooled["differences"]["pacmo_minus_pacmo_permuted"]["f2id"]
    for bound in found.values():
        assert bound == pytest.approx(-0.3)
    assert set(pooled["differences"]) == {
        "pacmo_minus_gru",
        "pacmo_minus_pacmo_permuted",
        "pacmo_minus_pacmo_augmented",
        "pacmo_augmented_minus_gru",
        "real_pairs_minus_wrong_partner",
    }


def test_sensitivity_says_which_metrics_see_the_partner(pooled):
    assert set(pooled["sensitivity"]) == {"any_action", "pacmo_any_action"}
    seen = pooled["sensitivity"]["any_action"]["mmd_pair"]
    assert seen["mean"] == pytest.approx(-0.3) and seen["sensitive"] is True


def test_the_gain_by_variations_is_pooled_by_fold_over_equal_seeds(pooled):
    found = pooled["augmentation"]
    assert found["each"] == {"f2id": pytest.approx([-0.05, -0.1])}
    assert found["folds"]["f2id"]["mean"] == pytest.approx(-0.075)
    assert found["clips"]["f2id"]["mean"] == pytest.approx(0.075 - 0.25)


def test_a_fold_with_too_few_units_leaves_means_without_intervals(tmp_path, monkeypatch):
    (tmp_path / "params.yaml").write_text("pool_pacmo: {confidence: 0.95, random_seed: 1}\n")
    monkeypatch.chdir(tmp_path)
    facts = {"autoencoder_sha256": "a", "matcher_sha256": "m", "unit": "clip", "n": N, "absent": {}}
    for fold, length in ((1, 1), (2, 101)):
        scores = [
            Score(row, 1, metric, np.full(3 if metric == "f2id_halves" else length, value))
            for row in ("real", "real_pairs", "wrong_partner", "pacmo", "pacmo_augmented")
            for metric, value in (("f2id", fold), ("f2id_halves", 1.0), ("mmd_pair", fold))
        ]
        write_scores(tmp_path / f"scores/{fold}.parquet", scores, facts)
    pool_pacmo.main(tmp_path / "scores", tmp_path / "pacmo.json")
    found = json.loads((tmp_path / "pacmo.json").read_text())
    assert found["rows"]["pacmo"]["f2id"] == {"mean": 1.5}
    assert found["rows"]["pacmo"]["f2id_halves"] == {"mean": 1.0, "low": 1.0, "high": 1.0}
    assert found["differences"]["pacmo_minus_pacmo_augmented"]["f2id"] == {"mean": 0.0}
    assert found["sensitivity"]["any_action"]["mmd_pair"] == {"mean": 0.0, "sensitive": False}
    assert found["augmentation"]["clips"]["f2id"] == {"mean": 0.0}
    gate = Gate(row="pacmo", metrics=("f2id",), max_noise_floor_ratio=2.0)
    found["rows"]["pacmo"]["f2id_floor"] = {"mean": 1.0}
    assert check_gate(found["rows"], found["rows"], gate) == []  # nothing to compare
    found["rows"]["pacmo"]["f2id_floor"] = {"mean": 0.1}
    (reason,) = check_gate(found["rows"], found["rows"], gate)
    assert "above 2 times its noise floor" in reason
