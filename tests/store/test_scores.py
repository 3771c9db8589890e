"""What is trusted: the scores that went in."""

import numpy as np
import polars as pl
import pytest

from pacmo_core.store.files import StoreError
from pacmo_core.store.scores import Score, read_scores, write_scores
from pacmo_core.store.tables import QuarantineRecord, write_rows

SCORES = [
    Score("pacmo", 1, "f2id", np.array([0.1, 0.2, 0.3])),
    Score("pacmo", 2, "f2id", np.array([0.4, 0.5, 0.6])),
    Score("gru", 1, "f2id_published", np.array([0.7, 0.8])),
]


def test_scores_and_facts_come_back(tmp_path):
    write_scores(tmp_path / "1.parquet", SCORES, {"n": {"test_clips": 3}})
    found, facts = read_scores(tmp_path / "1.parquet")
    assert facts == {"n": {"test_clips": 3}}
    for score, back in zip(SCORES, found, strict=True):
        assert (back.row, back.seed, back.metric) == (score.row, score.seed, score.metric)
        np.testing.assert_array_equal(back.values, score.values)
    table = pl.read_parquet(tmp_path / "1.parquet")
    assert table.filter(pl.col("replicate") == 0)["value"].to_list() == [0.1, 0.4, 0.7]


def test_a_score_that_is_no_number_is_refused(tmp_path):
    broken = Score("gru", 1, "ape", np.array([0.1, np.nan]))
    with pytest.raises(ValueError, match="gru, seed 1: ape is not finite"):
        write_scores(tmp_path / "1.parquet", [*SCORES, broken], {})
    assert not (tmp_path / "1.parquet").exists()


def test_no_scores_are_refused(tmp_path):
    with pytest.raises(ValueError, match="wanted scores to write; got none"):
        write_scores(tmp_path / "1.parquet", [], {})


def test_another_table_is_refused(tmp_path):
    write_rows(tmp_path / "q.parquet", QuarantineRecord, [])
    with pytest.raises(StoreError, match="wanted columns"):
        read_scores(tmp_path / "q.parquet")
