"""Parquet files of the store: opening them, and the check that they are what they should be.

Every file names the version of its schema in its metadata; a reader refuses files of another
version, other columns or types, and missing values. Any order of the columns and any row groups
are accepted, as other programs write them.
"""

import errno
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from pacmo_core.data.limits import file_fault
from pacmo_core.store.files import StoreError

VERSION = "1"
MAX_ROWS = 2_000_000  # of a table, which is read as a whole


@contextmanager
def parquet_errors(path: Path) -> Iterator[None]:
    """Raise a ``StoreError`` that names the file for whatever Arrow finds wrong with it."""
    try:
        yield
    except (pa.ArrowException, UnicodeDecodeError) as error:
        raise StoreError(f"{path}: not a complete Parquet file ({error})") from error
    except OSError as error:
        if error.errno is not None:
            raise  # the system's, such as a missing file
        raise StoreError(f"{path}: not a complete Parquet file ({error})") from error


def open_parquet(path: Path) -> pq.ParquetFile:
    """Open a Parquet file.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    StoreError
        If it is not a file, not Parquet, or cut short; the message names the file.
    """
    if not path.exists():
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path))
    if fault := file_fault(path, max_bytes=None):
        raise StoreError(f"{path}: {fault}")
    with parquet_errors(path):
        file = pq.ParquetFile(path)
        _ = file.schema_arrow  # built on demand; may be invalid
        return file


def check_version(schema: pa.Schema, path: Path) -> None:
    """Refuse a file of another version of the schema.

    Raises
    ------
    StoreError
        If the version is missing or another one.
    """
    version = (schema.metadata or {}).get(b"pacmo", b"none").decode(errors="replace")
    if version != VERSION:
        raise StoreError(f"{path}: wanted schema version {VERSION}, got {version}")


def check_columns(schema: pa.Schema, wanted: Sequence[pa.Field], path: Path) -> None:
    """Refuse a file without exactly the wanted columns, in any order.

    Raises
    ------
    StoreError
        If a column is missing, is there twice or is one too many, or has another type.
    """
    names = [field.name for field in wanted]
    if sorted(schema.names) != sorted(names):
        raise StoreError(f"{path}: wanted columns {names}, got {schema.names}")
    for field in wanted:
        got = schema.field(field.name).type
        if got != field.type and not (pa.types.is_string(field.type) and got == pa.large_string()):
            raise StoreError(f"{path}: wanted column {field.name} of {field.type}, got {got}")


def check_values(table: pa.Table, columns: Sequence[str], path: Path) -> None:
    """Refuse missing values in some columns, those nested in lists and structs too.

    Raises
    ------
    StoreError
        If there is one; the message names the column.
    """
    for name in columns:
        if any(_has_null(chunk) for chunk in table[name].chunks):
            raise StoreError(f"{path}: a value is missing in column {name}")


def read_table(file: pq.ParquetFile, wanted: Sequence[pa.Field], path: Path) -> pa.Table:
    """Read a whole table after the check of its columns; only nullable ones may lack values.

    Raises
    ------
    StoreError
        If it is cut short, or not of these columns.
    """
    check_columns(file.schema_arrow, wanted, path)
    if file.metadata.num_rows > MAX_ROWS:
        raise StoreError(f"{path}: wanted at most {MAX_ROWS} rows; got {file.metadata.num_rows}")
    with parquet_errors(path):
        table = file.read(columns=[field.name for field in wanted])
        table = table.select([field.name for field in wanted])
    check_values(table, [field.name for field in wanted if not field.nullable], path)
    return table


def _has_null(values: pa.Array) -> bool:
    if values.null_count:
        return True
    if pa.types.is_struct(values.type):
        return any(map(_has_null, values.flatten()))
    if pa.types.is_fixed_size_list(values.type):
        return _has_null(values.flatten())
    return False
