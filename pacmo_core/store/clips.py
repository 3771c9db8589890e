"""The facts beside the motions: a row a clip, a side a clip, a row an unusable capture."""

from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import TypeVar

import pyarrow as pa
import pyarrow.parquet as pq

from pacmo_core.store.atomic import whole_file
from pacmo_core.store.schema import VERSION, StoreError, check_version, open_parquet


@dataclass(frozen=True)
class ClipFacts:
    """One clip: where it comes from, who and what it shows, how good it is."""

    clip: str
    sequence: str
    dataset: str
    action: str
    subject_a: str
    subject_b: str
    recording: str
    skeleton: str
    fps: float
    duration: float
    frames: int
    start_frame: int
    source_file: str
    sha256: str
    bone_length_variation: float
    max_joint_speed: float
    contact_share: float
    filled_frames: int


@dataclass(frozen=True)
class SideFacts:
    """Where one clip stands in one fold: ``train``, ``validation``, ``test`` or ``dropped``."""

    clip: str
    side: str


@dataclass(frozen=True)
class QuarantineFacts:
    """One capture that was put aside, and why; ``line`` is 0 where there is none to name."""

    sequence: str
    file: str
    sha256: str
    line: int
    reason: str


Row = TypeVar("Row", ClipFacts, SideFacts, QuarantineFacts)
COLUMN_TYPES: dict[object, pa.DataType] = {
    str: pa.string(),
    float: pa.float64(),
    int: pa.int64(),
}


def write_rows(path: Path, kind: type[Row], rows: list[Row]) -> None:
    """Write a table of facts whole or not at all; no rows make an empty table."""
    columns = [pa.field(field.name, COLUMN_TYPES[field.type], False) for field in fields(kind)]
    schema = pa.schema(columns, metadata={"pacmo": VERSION})
    with whole_file(path) as partial:
        table = pa.Table.from_pylist([asdict(row) for row in rows], schema=schema)
        pq.write_table(table, partial, compression="zstd")


def read_rows(path: Path, kind: type[Row]) -> list[Row]:
    """Read a table of facts.

    Raises
    ------
    StoreError
        If the file is of another kind or version.
    """
    file = open_parquet(path)
    check_version(file.schema_arrow, path)
    wanted = [field.name for field in fields(kind)]
    if file.schema_arrow.names != wanted:
        raise StoreError(f"{path}: wanted columns {wanted}, got {file.schema_arrow.names}")
    return [kind(**row) for row in file.read().to_pylist()]
