"""What is trusted: the rows that went in."""

from dataclasses import replace
from math import inf
from pathlib import Path

import polars as pl
import pytest

from pacmo_core.store.files import StoreError
from pacmo_core.store.tables import (
    ClipRecord,
    QuarantineRecord,
    SplitRecord,
    VariationRecord,
    read_rows,
    read_variations,
    write_rows,
    write_variations,
)

ROW = QuarantineRecord(sequence="s", file="s.bvh", sha256="ab", line=3, reason="no second person")


def test_rows_come_back(tmp_path):
    write_rows(tmp_path / "q.parquet", QuarantineRecord, [ROW])
    assert read_rows(tmp_path / "q.parquet", QuarantineRecord) == [ROW]
    assert pl.read_parquet(tmp_path / "q.parquet")["reason"].to_list() == ["no second person"]


def test_no_rows_make_an_empty_table_with_its_columns(tmp_path):
    write_rows(tmp_path / "q.parquet", QuarantineRecord, [])
    assert read_rows(tmp_path / "q.parquet", QuarantineRecord) == []
    assert "reason" in pl.read_parquet(tmp_path / "q.parquet").columns


def test_a_table_of_another_kind_is_refused(tmp_path):
    write_rows(tmp_path / "q.parquet", QuarantineRecord, [ROW])
    with pytest.raises(StoreError, match="wanted columns"):
        read_rows(tmp_path / "q.parquet", ClipRecord)


SEGMENTS = ["left_forearm", "head"]
VARIATION = VariationRecord(
    variation="c~b-head-1.20",
    clip="c",
    kind="single",
    accepted=True,
    reason="",
    limit_ratio=0.4,
    measurements={"near_distance_error": 0.001, "attempts": 2.0},
    scales_a={"left_forearm": 1.0, "head": 1.0},
    scales_b={"left_forearm": 1.0, "head": 1.2},
)
REFUSED = replace(
    VARIATION,
    variation="d~r0000",
    clip="d",
    accepted=False,
    reason="refused",
    limit_ratio=inf,
    measurements={},
)


def test_rows_come_back_as_they_were(tmp_path: Path) -> None:
    write_variations(tmp_path / "v.parquet", [VARIATION, REFUSED], SEGMENTS)
    assert read_variations(tmp_path / "v.parquet") == [VARIATION, REFUSED]
    first = (tmp_path / "v.parquet").read_bytes()
    write_variations(tmp_path / "v.parquet", [VARIATION, REFUSED], SEGMENTS)
    assert (tmp_path / "v.parquet").read_bytes() == first


def test_a_table_of_nothing_can_be_read(tmp_path: Path) -> None:
    write_variations(tmp_path / "v.parquet", [], SEGMENTS)
    assert read_variations(tmp_path / "v.parquet") == []


def test_polars_finds_a_bone_by_its_name(tmp_path: Path) -> None:
    write_variations(tmp_path / "v.parquet", [VARIATION, REFUSED], SEGMENTS)
    table = pl.read_parquet(tmp_path / "v.parquet")
    heads = table.with_columns(head=pl.col("scales_b").struct.field("head"))
    assert heads.filter(pl.col("accepted"))["head"].to_list() == [1.2]
    assert table["near_distance_error"].to_list() == [0.001, None]
    assert table["scales_a"].struct.fields == SEGMENTS


def test_a_table_of_another_kind_is_no_table_of_variations(tmp_path: Path) -> None:
    write_rows(tmp_path / "s.parquet", SplitRecord, [SplitRecord("c", "train")])
    with pytest.raises(StoreError, match="wanted a table of variations"):
        read_variations(tmp_path / "s.parquet")
