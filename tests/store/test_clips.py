"""What is trusted: the rows that went in."""

import polars as pl
import pytest

from pacmo_core.store.clips import ClipFacts, QuarantineFacts, read_rows, write_rows
from pacmo_core.store.schema import StoreError

ROW = QuarantineFacts(sequence="s", file="s.bvh", sha256="ab", line=3, reason="no second person")


def test_rows_come_back(tmp_path):
    write_rows(tmp_path / "q.parquet", QuarantineFacts, [ROW])
    assert read_rows(tmp_path / "q.parquet", QuarantineFacts) == [ROW]
    assert pl.read_parquet(tmp_path / "q.parquet")["reason"].to_list() == ["no second person"]


def test_no_rows_make_an_empty_table_with_its_columns(tmp_path):
    write_rows(tmp_path / "q.parquet", QuarantineFacts, [])
    assert read_rows(tmp_path / "q.parquet", QuarantineFacts) == []
    assert "reason" in pl.read_parquet(tmp_path / "q.parquet").columns


def test_a_table_of_another_kind_is_refused(tmp_path):
    write_rows(tmp_path / "q.parquet", QuarantineFacts, [ROW])
    with pytest.raises(StoreError, match="wanted columns"):
        read_rows(tmp_path / "q.parquet", ClipFacts)
