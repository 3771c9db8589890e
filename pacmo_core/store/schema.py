"""What stands in the Parquet files: a row a frame in one, a row a clip in the other.

The skeleton and the schema's version stand in the file's metadata; a reader refuses a version
that it does not know.
"""

import json
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from pacmo_core.data.skeleton import Skeleton

VERSION = "1"


class StoreError(ValueError):
    """A Parquet file that is not a file of this store, or not one that this version reads."""


def motion_schema(skeleton: Skeleton) -> pa.Schema:
    """Describe a row a frame: ``clip``, ``frame``, ``time`` (s), two ``(J, 3)`` poses (m)."""
    # Plain fixed-size lists, not the fixed_shape_tensor extension: polars reads these as
    # Array(Float32, (J, 3)) and people look into the files with polars.
    pose = pa.list_(pa.list_(pa.float32(), 3), len(skeleton.joints))
    fields = [
        pa.field("clip", pa.string(), nullable=False),
        pa.field("frame", pa.int32(), nullable=False),
        pa.field("time", pa.float64(), nullable=False),
        pa.field("person_a", pose, nullable=False),
        pa.field("person_b", pose, nullable=False),
    ]
    return pa.schema(fields, metadata={"pacmo": VERSION, "skeleton": _to_json(skeleton)})


def skeleton_of(schema: pa.Schema, path: Path) -> Skeleton:
    """Read the skeleton from a file's schema.

    Raises
    ------
    StoreError
        If the schema's version or skeleton is missing or unknown.
    """
    check_version(schema, path)
    text = schema.metadata.get(b"skeleton")
    if text is None:
        raise StoreError(f"{path}: no skeleton in its metadata; it is not a file of motions")
    return _from_json(text, path)


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


def _to_json(skeleton: Skeleton) -> str:
    facts = {
        "name": skeleton.name,
        "joints": skeleton.joints,
        "parents": skeleton.parents,
        "left_right": skeleton.left_right,
    }
    return json.dumps(facts)


def _from_json(text: bytes, path: Path) -> Skeleton:
    try:
        facts: dict[str, Any] = json.loads(text)
        return Skeleton(
            name=facts["name"],
            joints=tuple(facts["joints"]),
            parents=tuple(facts["parents"]),
            left_right=tuple((left, right) for left, right in facts["left_right"]),
        )
    except (KeyError, TypeError, ValueError) as fault:
        raise StoreError(f"{path}: its metadata hold no readable skeleton ({fault})") from fault
