"""What stands in the Parquet files: a row a frame in one, a row a clip in the other.

The skeleton and the schema's version stand in the file's metadata; a reader refuses a version
that it does not know.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, TypeVar

import pyarrow as pa
import pyarrow.parquet as pq

from pacmo_core.store.files import StoreError, atomic_file

VERSION = "1"


def check_version(schema: pa.Schema, path: Path) -> None:
    """Refuse a file that another version of the schema wrote."""
    version = (schema.metadata or {}).get(b"pacmo", b"none").decode()
    if version != VERSION:
        raise StoreError(f"{path}: wanted schema version {VERSION}, got {version}")


def open_parquet(path: Path) -> pq.ParquetFile:
    """Open a Parquet file, or say which file is not one.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    StoreError
        If it is not Parquet, or cut short.
    """
    try:
        return pq.ParquetFile(path)
    except pa.ArrowInvalid as fault:
        raise StoreError(f"{path}: not a whole Parquet file ({fault})") from fault


@dataclass(frozen=True)
class ClipRecord:
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
class SplitRecord:
    """Where one clip stands in one fold: ``train``, ``validation``, ``test`` or ``dropped``."""

    clip: str
    split: str


@dataclass(frozen=True)
class QuarantineRecord:
    """One capture that was put aside, and why; ``line`` is 0 where there is none to name."""

    sequence: str
    file: str
    sha256: str
    line: int
    reason: str


Record = TypeVar("Record", ClipRecord, SplitRecord, QuarantineRecord)
COLUMN_TYPES: dict[object, pa.DataType] = {
    str: pa.string(),
    float: pa.float64(),
    int: pa.int64(),
}


def write_rows(path: Path, kind: type[Record], rows: list[Record]) -> None:
    """Write a table of facts whole or not at all; no rows make an empty table."""
    columns = [pa.field(field.name, COLUMN_TYPES[field.type], False) for field in fields(kind)]
    schema = pa.schema(columns, metadata={"pacmo": VERSION})
    with atomic_file(path) as partial:
        table = pa.Table.from_pylist([asdict(row) for row in rows], schema=schema)
        pq.write_table(table, partial, compression="zstd")


def read_rows(path: Path, kind: type[Record]) -> list[Record]:
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


# Names in a family's folder: folders of the variations that are kept, of those beyond a limit and
# of the clips that were varied, a file a clip; and the facts of all.
GOOD = "motions"
FAILED = "failed"
SOURCES = "sources"
VARIATIONS = "variations.parquet"

PLAIN = ("variation", "clip", "kind", "kept", "reason", "badness")
SCALES = ("scales_a", "scales_b")


@dataclass(frozen=True)
class VariationRecord:
    """One variation.

    Parameters
    ----------
    variation : its name in the file of motions, ``CLIP~NAME``
    clip : the source
    kind : ``uniform``, ``single``, ``profile`` or ``random``
    kept : whether it is within the limits
    reason : why it is not
    badness : the worst figure as a share of its limit: good up to 1; infinite where it is no
        number or the solver refused the source
    figures : the report's, by name; none where the solver refused the source
    scales_a, scales_b : of the segments of either body, by name, in the order of the bones
    """

    variation: str
    clip: str
    kind: str
    kept: bool
    reason: str
    badness: float
    figures: dict[str, float]
    scales_a: dict[str, float]
    scales_b: dict[str, float]


def write_variations(path: Path, rows: Sequence[VariationRecord], segments: Sequence[str]) -> None:
    """Write the table whole or not at all.

    Parameters
    ----------
    segments : names, in the order of the bones
    """
    figures = list(dict.fromkeys(name for row in rows for name in row.figures))
    body = pa.struct([pa.field(name, pa.float64(), nullable=False) for name in segments])
    columns = [
        *(pa.field(name, pa.string(), nullable=False) for name in ("variation", "clip", "kind")),
        pa.field("kept", pa.bool_(), nullable=False),
        pa.field("reason", pa.string(), nullable=False),
        pa.field("badness", pa.float64(), nullable=False),
        *(pa.field(name, pa.float64()) for name in figures),
        *(pa.field(name, body, nullable=False) for name in SCALES),
    ]
    schema = pa.schema(columns, metadata={"pacmo": VERSION, "figures": json.dumps(figures)})
    with atomic_file(path) as partial:
        table = pa.Table.from_pylist([_flat(row) for row in rows], schema=schema)
        pq.write_table(table, partial, compression="zstd")


def read_variations(path: Path) -> list[VariationRecord]:
    """Read the table.

    Raises
    ------
    StoreError
        If the file is of another kind or version.
    """
    file = open_parquet(path)
    check_version(file.schema_arrow, path)
    text = file.schema_arrow.metadata.get(b"figures")
    if text is None or file.schema_arrow.names[: len(PLAIN)] != list(PLAIN):
        raise StoreError(f"{path}: wanted a table of variations, got {file.schema_arrow.names}")
    figures = json.loads(text)
    return [_fact(row, figures) for row in file.read().to_pylist()]


def _flat(row: VariationRecord) -> dict[str, Any]:
    plain = {name: getattr(row, name) for name in (*PLAIN, *SCALES)}
    return plain | row.figures


def _fact(row: dict[str, Any], figures: list[str]) -> VariationRecord:
    found = {name: row[name] for name in figures if row[name] is not None}
    return VariationRecord(figures=found, **{name: row[name] for name in (*PLAIN, *SCALES)})
