"""Scores in Parquet: a row for each bootstrap replicate; what holds for all is in the metadata."""

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from pacmo_core.store.files import StoreError, atomic_file
from pacmo_core.store.parquet import VERSION, check_version, open_parquet, read_table

COLUMNS = pa.schema(
    [
        pa.field("row", pa.string(), nullable=False),
        pa.field("seed", pa.int64(), nullable=False),
        pa.field("metric", pa.string(), nullable=False),
        pa.field("replicate", pa.int32(), nullable=False),
        pa.field("value", pa.float64(), nullable=False),
    ]
)


@dataclass(frozen=True)
class Score:
    """One metric of one row and seed, with its bootstrap replicates.

    Parameters
    ----------
    row, metric : names
    seed : of the training; 0 for a row without one
    values : (1 + B,) float64, of all samples first, then of each of B bootstrap replicates
    """

    row: str
    seed: int
    metric: str
    values: NDArray[np.float64]


def write_scores(path: Path, scores: Sequence[Score], metadata: Mapping[str, Any]) -> None:
    """Write scores atomically.

    Parameters
    ----------
    metadata : what holds for all scores, as JSON can represent it

    Raises
    ------
    ValueError
        If a value is not finite, or there are no scores.
    """
    if not scores:
        raise ValueError(f"{path}: wanted scores to write; got none")
    for score in scores:
        if not np.isfinite(score.values).all():
            raise ValueError(f"{score.row}, seed {score.seed}: {score.metric} is not finite")
    lengths = [len(score.values) for score in scores]
    columns = {
        "row": np.repeat([score.row for score in scores], lengths),
        "seed": np.repeat([score.seed for score in scores], lengths),
        "metric": np.repeat([score.metric for score in scores], lengths),
        "replicate": np.concatenate([np.arange(length, dtype=np.int32) for length in lengths]),
        "value": np.concatenate([score.values for score in scores]),
    }
    text = json.dumps(metadata, sort_keys=True, allow_nan=False)
    schema = COLUMNS.with_metadata({"pacmo": VERSION, "scores": text})
    with atomic_file(path) as partial:
        pq.write_table(pa.table(columns, schema=schema), partial, compression="zstd")


def read_scores(path: Path) -> tuple[list[Score], dict[str, Any]]:
    """Read scores and their metadata.

    Raises
    ------
    StoreError
        If the file is of another kind or version.
    """
    file = open_parquet(path)
    check_version(file.schema_arrow, path)
    metadata = _metadata(file.schema_arrow, path)
    table = read_table(file, list(COLUMNS), path)
    row, seed, metric, replicate, value = (table[name].to_numpy() for name in COLUMNS.names)
    first = np.flatnonzero(replicate == 0)
    if len(replicate) and replicate[0] != 0:
        raise StoreError(f"{path}: wanted replicate 0 of each score first; got {replicate[0]}")
    ends = np.append(first[1:], len(replicate))[: len(first)]
    scores = [
        Score(str(row[i]), int(seed[i]), str(metric[i]), np.array(value[i:end]))
        for i, end in zip(first, ends, strict=True)
    ]
    return scores, metadata


def _metadata(schema: pa.Schema, path: Path) -> dict[str, Any]:
    metadata: object = None
    with suppress(KeyError, ValueError, RecursionError):
        metadata = json.loads(schema.metadata[b"scores"])
    if not isinstance(metadata, dict):
        raise StoreError(f"{path}: wanted columns {COLUMNS.names} and scores in its metadata")
    return metadata
