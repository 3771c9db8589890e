"""Truth: the motions that were written; the files are altered as other programs might."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pacmo_core.data.interaction import Interaction
from pacmo_core.store import motions
from pacmo_core.store.files import StoreError
from pacmo_core.store.motions import MotionReader, read_motion, stream_motions, write_motions
from pacmo_core.store.scores import Score, read_scores, write_scores
from pacmo_core.store.tables import QuarantineRecord, read_rows, read_variations, write_rows
from tests.strategies import SMALL, make_set

CLIPS = make_set(np.random.default_rng(1), 5)
Alter = Callable[[pa.Table], pa.Table]


@pytest.fixture
def file(tmp_path: Path) -> Path:
    with write_motions(tmp_path / "m.parquet", SMALL) as writer:
        for name, clip in CLIPS.items():
            writer.add(name, clip)
    return tmp_path / "m.parquet"


def rewrite(file: Path, alter: Alter = lambda table: table, **options: Any) -> None:
    pq.write_table(alter(pq.read_table(file)), file, **options)


def replaced(table: pa.Table, name: str, values: Any, kind: pa.DataType | None = None) -> pa.Table:
    index = table.column_names.index(name)
    return table.set_column(index, name, pa.array(values, kind or table.schema.field(name).type))


def equal(one: Interaction, other: Interaction) -> bool:
    return all(
        np.array_equal(getattr(one, name), getattr(other, name))
        for name in ("times", "person_a", "person_b")
    )


@pytest.mark.parametrize("statistics", [True, False])
@pytest.mark.parametrize("rows", [1, 7, 1000])
def test_every_row_group_of_a_clip_is_read(file: Path, rows: int, statistics: bool) -> None:
    rewrite(file, row_group_size=rows, write_statistics=statistics)
    reader, streamed = MotionReader(file), dict(stream_motions(file))
    assert list(streamed) == list(CLIPS)
    for name, clip in CLIPS.items():
        assert equal(streamed[name], clip)
        assert equal(read_motion(file, name), clip)
        assert equal(reader.read(name), clip)


def test_columns_may_come_in_any_order(file: Path) -> None:
    rewrite(file, lambda table: table.select(table.column_names[::-1]), row_group_size=9)
    assert all(equal(read_motion(file, name), clip) for name, clip in CLIPS.items())


def test_a_file_without_rows_has_no_clips(file: Path) -> None:
    rewrite(file, lambda table: table.slice(0, 0))
    assert list(stream_motions(file)) == []
    with pytest.raises(KeyError, match="no clip x"):
        read_motion(file, "x")


def ragged(table: pa.Table) -> pa.Table:
    poses = table["person_a"].to_pylist()
    poses[0], poses[1] = poses[0][:-1], [*poses[1], poses[0][-1]]
    return replaced(table, "person_a", poses, pa.list_(pa.list_(pa.float32(), 3)))


def null_pose(table: pa.Table) -> pa.Table:
    poses = table["person_a"].to_pylist()
    poses[1] = None
    return replaced(table, "person_a", poses)


def null_number(table: pa.Table) -> pa.Table:
    poses = table["person_b"].to_pylist()
    poses[2][1] = [0.0, None, 0.0]
    return replaced(table, "person_b", poses)


def a_day_later(table: pa.Table) -> pa.Table:
    times = table["time"].to_numpy().copy()
    times[1 : len(CLIPS["clip0000"].times)] += 86_400
    return replaced(table, "time", times)


def far_away(table: pa.Table) -> pa.Table:
    poses = table["person_b"].to_pylist()
    poses[2][1] = [0.0, 0.0, 1e30]
    return replaced(table, "person_b", poses)


FAULTS: dict[str, Alter] = {
    "clip clip0000: person_b is 1e\\+30 m away": far_away,
    "frame 1 is 1e-300 s after": lambda t: replaced(t, "time", t["frame"].to_numpy() * 1e-300),
    "wanted column person_a of": ragged,
    "a value is missing in column person_a": null_pose,
    "a value is missing in column person_b": null_number,
    "frame 1 is 86400 s after": a_day_later,
    "wanted column time of double, got string": lambda t: replaced(
        t, "time", list(map(str, t["time"].to_pylist())), pa.string()
    ),
    "wanted column clip of string, got int64": lambda t: replaced(
        t, "clip", range(len(t)), pa.int64()
    ),
    "wanted columns": lambda t: t.drop_columns(["frame"]),
    "clips must be in ascending order": lambda t: t.take(np.arange(len(t))[::-1]),
    "clip clip0000: wanted frames 0, 1": lambda t: t.slice(1),
    "no valid skeleton": lambda t: t.replace_schema_metadata(
        {b"pacmo": b"1", b"skeleton": b'{"name":"x","joints":[1],"parents":[-1],"left_right":[]}'}
    ),
    "wanted schema version 1": lambda t: t.replace_schema_metadata({b"pacmo": b"\xff\xfe"}),
}


def test_a_clip_without_a_name_is_refused(file: Path) -> None:
    rewrite(file, lambda table: replaced(table, "clip", [""] * len(table)))
    with pytest.raises(StoreError, match=r"m.parquet: a clip has no name"):
        list(stream_motions(file))


@pytest.mark.parametrize("reason", FAULTS)
def test_a_table_that_is_otherwise_is_refused_by_name(file: Path, reason: str) -> None:
    rewrite(file, FAULTS[reason])
    with pytest.raises(StoreError, match=f"m.parquet: .*{reason}"):
        list(stream_motions(file))
    with pytest.raises(StoreError, match=f"m.parquet: .*{reason}"):
        read_motion(file, "clip0000")


def test_a_row_group_that_is_too_large_is_refused_unread(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rewrite(file)
    monkeypatch.setattr(motions, "MAX_POSITIONS", 40)
    with pytest.raises(StoreError, match="row group 0: wanted at most 20 frames"):
        list(stream_motions(file))


def test_long_clips_share_no_row_group(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    longest = max(len(clip.times) for clip in CLIPS.values())
    monkeypatch.setattr(motions, "MAX_POSITIONS", longest * len(SMALL.joints))
    with write_motions(tmp_path / "m.parquet", SMALL) as writer:
        for name, clip in CLIPS.items():
            writer.add(name, clip)
    assert pq.ParquetFile(tmp_path / "m.parquet").num_row_groups > 1
    assert len(dict(stream_motions(tmp_path / "m.parquet"))) == len(CLIPS)


@pytest.mark.parametrize("read", [read_variations, read_scores, lambda p: read_motion(p, "x")])
def test_a_pipe_is_refused_unopened(tmp_path: Path, read: Callable[[Path], object]) -> None:
    os.mkfifo(tmp_path / "m.parquet")
    with pytest.raises(StoreError, match="wanted a file; got a named pipe"):
        read(tmp_path / "m.parquet")


def test_tables_of_other_types_or_with_missing_values_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "q.parquet"
    write_rows(path, QuarantineRecord, [QuarantineRecord("s", "f", "0", 1, "r")])
    rewrite(path, lambda t: replaced(t, "reason", [None], pa.string()))
    with pytest.raises(StoreError, match="a value is missing in column reason"):
        read_rows(path, QuarantineRecord)
    rewrite(path, lambda t: replaced(t, "reason", ["r"]))
    assert read_rows(path, QuarantineRecord)[0].reason == "r"
    rewrite(path, lambda t: replaced(t, "line", ["x"], pa.string()))
    with pytest.raises(StoreError, match="wanted column line of int64, got string"):
        read_rows(path, QuarantineRecord)


@pytest.mark.parametrize("text", [b"[]", b"null", b"{", b"[" * 100_000])
def test_metadata_of_another_kind_are_refused(tmp_path: Path, text: bytes) -> None:
    path = tmp_path / "s.parquet"
    write_scores(path, [Score("row", 1, "metric", np.zeros(3))], {"n": 2})
    facts = {b"pacmo": b"1", b"scores": text, b"measurements": text}
    rewrite(path, lambda t: t.replace_schema_metadata(facts))
    with pytest.raises(StoreError, match="and scores in its metadata"):
        read_scores(path)
    with pytest.raises(StoreError, match="wanted"):
        read_variations(path)
