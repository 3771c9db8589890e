"""Tables in Parquet: a record of each clip, split, quarantined capture and variation.

Every file of the project names the version of its schema in its metadata; a reader refuses files
of another version.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, TypeVar

import pyarrow as pa
import pyarrow.parquet as pq

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.names import printable
from pacmo_core.store.files import StoreError, atomic_file

VERSION = "1"


def check_version(schema: pa.Schema, path: Path) -> None:
    """Refuse a file of another version of the schema.

    Raises
    ------
    StoreError
        If the version is missing or another one.
    """
    version = (schema.metadata or {}).get(b"pacmo", b"none").decode()
    if version != VERSION:
        raise StoreError(f"{path}: wanted schema version {VERSION}, got {version}")


def open_parquet(path: Path) -> pq.ParquetFile:
    """Open a Parquet file.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    StoreError
        If it is not Parquet, or cut short; the message names the file.
    """
    try:
        return pq.ParquetFile(path)
    except pa.ArrowInvalid as error:
        raise StoreError(f"{path}: not a complete Parquet file ({error})") from error


@dataclass(frozen=True)
class ClipRecord:
    """One clip: its origin, its people and action, its quality.

    Parameters
    ----------
    clip : name (``pacmo_core.data.names``)
    sequence : that the clip was cut from
    dataset, action : names
    subject_a, subject_b : the two people; empty where the dataset does not name them
    recording : clips of one recording stay in one split
    skeleton : name
    fps, duration, frames : frames a second, seconds, count
    start_frame : of the clip in its sequence
    source_file, sha256 : of the raw capture
    bone_length_variation, max_joint_speed, contact_share : as in ``pacmo_core.data.quality``
    filled_frames : frames that were missing in the capture and interpolated
    """

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

    def for_clip(self, name: str, start_frame: int, clip: Interaction) -> "ClipRecord":
        """Return the record of a clip that was cut from the sequence of this record."""
        return replace(
            self,
            clip=name,
            duration=clip.duration,
            frames=len(clip.times),
            start_frame=start_frame,
        )


@dataclass(frozen=True)
class SplitRecord:
    """The split of one clip in one fold: ``train``, ``validation``, ``test`` or ``dropped``."""

    clip: str
    split: str


@dataclass(frozen=True)
class QuarantineRecord:
    """One capture that is not used, and the reason; ``line`` is 0 where no line is to blame.

    Texts may come from the capture itself: control characters in them are escaped.
    """

    sequence: str
    file: str
    sha256: str
    line: int
    reason: str

    def __post_init__(self) -> None:
        for name in ("sequence", "file", "reason"):
            object.__setattr__(self, name, printable(getattr(self, name)))


Record = TypeVar("Record", ClipRecord, SplitRecord, QuarantineRecord)
COLUMN_TYPES: dict[object, pa.DataType] = {
    str: pa.string(),
    float: pa.float64(),
    int: pa.int64(),
}


def write_rows(path: Path, kind: type[Record], rows: list[Record]) -> None:
    """Write a table of records atomically; without rows it is empty."""
    columns = [pa.field(field.name, COLUMN_TYPES[field.type], False) for field in fields(kind)]
    schema = pa.schema(columns, metadata={"pacmo": VERSION})
    with atomic_file(path) as partial:
        table = pa.Table.from_pylist([asdict(row) for row in rows], schema=schema)
        pq.write_table(table, partial, compression="zstd")


def read_rows(path: Path, kind: type[Record]) -> list[Record]:
    """Read a table of records.

    Raises
    ------
    StoreError
        If the file is of another kind or version.
    """
    file = open_parquet(path)
    check_version(file.schema_arrow, path)
    columns = [field.name for field in fields(kind)]
    if file.schema_arrow.names != columns:
        raise StoreError(f"{path}: wanted columns {columns}, got {file.schema_arrow.names}")
    return [kind(**row) for row in file.read().to_pylist()]


# Names in the folder of a dataset of variations: folders of the accepted variations, of those
# beyond a limit and of the sources, a file a clip; and the table of all variations.
ACCEPTED = "motions"
FAILED = "failed"
SOURCES = "sources"
VARIATIONS = "variations.parquet"

FIXED_COLUMNS = ("variation", "clip", "kind", "accepted", "reason", "limit_ratio")
SCALES = ("scales_a", "scales_b")


@dataclass(frozen=True)
class VariationRecord:
    """One variation.

    Parameters
    ----------
    variation : its name, ``CLIP~NAME``
    clip : the source
    kind : ``uniform``, ``single``, ``profile`` or ``random``
    accepted : whether it is within the limits
    reason : why it is not
    limit_ratio : the largest ratio of a measurement to its limit: accepted up to 1; infinite where
        a measurement is not a number or the solver refused the source
    measurements : of the solver's report, by name; none where the solver refused the source
    scales_a, scales_b : scales of the segments of either body, by name, in the order of the bones
    """

    variation: str
    clip: str
    kind: str
    accepted: bool
    reason: str
    limit_ratio: float
    measurements: dict[str, float]
    scales_a: dict[str, float]
    scales_b: dict[str, float]


def write_variations(path: Path, rows: Sequence[VariationRecord], segments: Sequence[str]) -> None:
    """Write the table of variations atomically; the scales of a body are a struct.

    Parameters
    ----------
    segments : names, in the order of the bones
    """
    measured = list(dict.fromkeys(name for row in rows for name in row.measurements))
    body = pa.struct([pa.field(name, pa.float64(), nullable=False) for name in segments])
    columns = [
        *(pa.field(name, pa.string(), nullable=False) for name in ("variation", "clip", "kind")),
        pa.field("accepted", pa.bool_(), nullable=False),
        pa.field("reason", pa.string(), nullable=False),
        pa.field("limit_ratio", pa.float64(), nullable=False),
        *(pa.field(name, pa.float64()) for name in measured),
        *(pa.field(name, body, nullable=False) for name in SCALES),
    ]
    schema = pa.schema(columns, metadata={"pacmo": VERSION, "measurements": json.dumps(measured)})
    with atomic_file(path) as partial:
        table = pa.Table.from_pylist([_columns(row) for row in rows], schema=schema)
        pq.write_table(table, partial, compression="zstd")


def read_variations(path: Path) -> list[VariationRecord]:
    """Read the table of variations.

    Raises
    ------
    StoreError
        If the file is of another kind or version.
    """
    file = open_parquet(path)
    check_version(file.schema_arrow, path)
    text = file.schema_arrow.metadata.get(b"measurements")
    if text is None or file.schema_arrow.names[: len(FIXED_COLUMNS)] != list(FIXED_COLUMNS):
        raise StoreError(f"{path}: wanted a table of variations, got {file.schema_arrow.names}")
    measured = json.loads(text)
    return [_record(row, measured) for row in file.read().to_pylist()]


def _columns(row: VariationRecord) -> dict[str, Any]:
    fixed = {name: getattr(row, name) for name in (*FIXED_COLUMNS, *SCALES)}
    return fixed | row.measurements


def _record(row: dict[str, Any], measured: list[str]) -> VariationRecord:
    values = {name: row[name] for name in measured if row[name] is not None}
    return VariationRecord(
        measurements=values, **{name: row[name] for name in (*FIXED_COLUMNS, *SCALES)}
    )
