"""Parquet of a table of joints: a row a frame, a column a coordinate, the rest as metadata.

The one module of the formats that imports pyarrow. Files of clips, the store's own Parquet, have
another layout and are named with a clip.
"""

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from pacmo_core.data.limits import MAX_NUMBERS
from pacmo_core.formats.base import FormatError
from pacmo_core.formats.table_columns import Columns, wanted_columns
from pacmo_core.formats.tables import short_reason

_STORE_KEY = b"pacmo"  # of the metadata of the store's files
_BROKEN = (pa.ArrowException, OSError, ValueError, MemoryError, KeyError, OverflowError)


def is_clip_file(file: Path) -> bool:
    """Whether a Parquet file is one of the store, with clips by name; false if it is broken."""
    try:
        with pq.ParquetFile(file) as opened:
            return _STORE_KEY in _metadata(opened)
    except _BROKEN:
        return False


def parquet_columns(file: Path) -> Columns:
    """Read the metadata and the columns of people and times.

    Raises
    ------
    FormatError
        If the file is no Parquet, is one of clips, or has a column of something else than numbers.
    """
    try:
        with pq.ParquetFile(file) as opened:
            return _read_columns(file, opened)
    except FormatError:
        raise
    except _BROKEN as error:
        raise FormatError(file, f"not a complete Parquet file: {short_reason(error)}") from error


def parquet_bytes(facts: Mapping[str, str], columns: Mapping[str, NDArray[Any]]) -> bytes:
    """Write columns, with facts as metadata of the file."""
    table = pa.table({name: pa.array(column) for name, column in columns.items()})
    written = io.BytesIO()
    pq.write_table(table.replace_schema_metadata(facts), written, compression="zstd")
    return written.getvalue()


def _read_columns(file: Path, opened: pq.ParquetFile) -> Columns:
    schema = opened.schema_arrow
    metadata = _metadata(opened)
    if _STORE_KEY in metadata:
        raise FormatError(file, "a file of clips, no table of joints: name one of its clips")
    facts = {
        key.decode("utf-8", "replace"): v.decode("utf-8", "replace") for key, v in metadata.items()
    }
    names = wanted_columns(file, schema.names)
    for name in names:
        kind = schema.field(name).type
        if not (pa.types.is_integer(kind) or pa.types.is_floating(kind)):
            raise FormatError(file, f"{name!r}: wanted a column of numbers; got {kind}")
    if opened.metadata.num_rows * len(names) > MAX_NUMBERS:
        shape = f"{opened.metadata.num_rows} rows of {len(names)} columns"
        raise FormatError(file, f"{shape} are more than {MAX_NUMBERS} numbers")
    table = opened.read(columns=names, use_threads=False)
    missing = [name for name in names if table[name].null_count]
    if missing:
        raise FormatError(file, f"{missing[0]!r}: a row has no value")
    values = {name: table[name].to_numpy().astype(np.float64) for name in names}
    return Columns(facts, values)


def _metadata(opened: pq.ParquetFile) -> Mapping[bytes, bytes]:
    # Of the file, not of its Arrow schema, in which Polars does not repeat it.
    return opened.metadata.metadata or {}
