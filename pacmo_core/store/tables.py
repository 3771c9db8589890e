"""Tables in Parquet: a record of each clip, split, quarantined capture and variation."""

import json
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, TypeVar

import pyarrow as pa
import pyarrow.parquet as pq

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.limits import printable
from pacmo_core.store.files import StoreError, atomic_file
from pacmo_core.store.parquet import VERSION, check_version, open_parquet, read_table


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
    synthetic : whether the capture was generated, not recorded
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
    synthetic: bool

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
    bool: pa.bool_(),
}


def write_rows(path: Path, kind: type[Record], rows: list[Record]) -> None:
    """Write a table of records atomically; without rows it is empty."""
    schema = pa.schema(_fields(kind), metadata={"pacmo": VERSION})
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
    return [kind(**row) for row in read_table(file, _fields(kind), path).to_pylist()]


def _fields(kind: type[Record]) -> list[pa.Field]:
    return [pa.field(field.name, COLUMN_TYPES[field.type], False) for field in fields(kind)]


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
    columns = _variation_fields(measured, segments)
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
    schema = file.schema_arrow
    measured = _measurements(schema, path)
    columns = _variation_fields(measured, _segments(schema))
    return [_record(row, measured) for row in read_table(file, columns, path).to_pylist()]


def _variation_fields(measured: Sequence[str], segments: Sequence[str]) -> list[pa.Field]:
    body = pa.struct([pa.field(name, pa.float64(), nullable=False) for name in segments])
    types = (*(pa.string(),) * 3, pa.bool_(), pa.string(), pa.float64())
    return [
        *(pa.field(name, t, False) for name, t in zip(FIXED_COLUMNS, types, strict=True)),
        *(pa.field(name, pa.float64()) for name in measured),
        *(pa.field(name, body, nullable=False) for name in SCALES),
    ]


def _measurements(schema: pa.Schema, path: Path) -> list[str]:
    """Read the names of the measurements from the metadata."""
    names: object = None
    with suppress(KeyError, ValueError, RecursionError):
        names = json.loads(schema.metadata[b"measurements"])
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise StoreError(f"{path}: wanted a table of variations, got {schema.names}")
    return names


def _segments(schema: pa.Schema) -> list[str]:
    """List the segments of the first column of scales; none where there is no such column."""
    index = schema.get_field_index(SCALES[0])
    if index < 0 or not pa.types.is_struct(schema.field(index).type):
        return []
    return [field.name for field in schema.field(index).type]


def _columns(row: VariationRecord) -> dict[str, Any]:
    fixed = {name: getattr(row, name) for name in (*FIXED_COLUMNS, *SCALES)}
    return fixed | row.measurements


def _record(row: dict[str, Any], measured: list[str]) -> VariationRecord:
    values = {name: row[name] for name in measured if row[name] is not None}
    return VariationRecord(
        measurements=values, **{name: row[name] for name in (*FIXED_COLUMNS, *SCALES)}
    )
