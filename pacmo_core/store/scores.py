"""Scores in Parquet: a row a draw, and in the metadata the facts that hold for all of them."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from pacmo_core.store.files import StoreError, atomic_file
from pacmo_core.store.tables import VERSION, check_version, open_parquet

COLUMNS = pa.schema(
    [
        pa.field("row", pa.string(), nullable=False),
        pa.field("seed", pa.int64(), nullable=False),
        pa.field("metric", pa.string(), nullable=False),
        pa.field("draw", pa.int32(), nullable=False),
        pa.field("value", pa.float64(), nullable=False),
    ]
)


@dataclass(frozen=True)
class Score:
    """One metric of one row and seed.

    Parameters
    ----------
    row, metric : names
    seed : of the run that made the row; 0 for what no run made
    values : (1 + B,), on all samples first, then on each draw
    """

    row: str
    seed: int
    metric: str
    values: NDArray[np.float64]


def write_scores(path: Path, scores: Sequence[Score], facts: Mapping[str, Any]) -> None:
    """Write scores whole or not at all.

    Parameters
    ----------
    facts : what holds for all of them, in JSON's terms

    Raises
    ------
    ValueError
        If a value is not finite.
    """
    for score in scores:
        if not np.isfinite(score.values).all():
            raise ValueError(f"{score.row}, seed {score.seed}: {score.metric} is not finite")
    lengths = [len(score.values) for score in scores]
    columns = {
        "row": np.repeat([score.row for score in scores], lengths),
        "seed": np.repeat([score.seed for score in scores], lengths),
        "metric": np.repeat([score.metric for score in scores], lengths),
        "draw": np.concatenate([np.arange(length, dtype=np.int32) for length in lengths]),
        "value": np.concatenate([score.values for score in scores]),
    }
    text = json.dumps(facts, sort_keys=True, allow_nan=False)
    schema = COLUMNS.with_metadata({"pacmo": VERSION, "facts": text})
    with atomic_file(path) as partial:
        pq.write_table(pa.table(columns, schema=schema), partial, compression="zstd")


def read_scores(path: Path) -> tuple[list[Score], dict[str, Any]]:
    """Read scores and their facts.

    Raises
    ------
    StoreError
        If the file is of another kind or version.
    """
    file = open_parquet(path)
    check_version(file.schema_arrow, path)
    text = file.schema_arrow.metadata.get(b"facts")
    if text is None or file.schema_arrow.names != COLUMNS.names:
        raise StoreError(f"{path}: wanted columns {COLUMNS.names} and facts in the metadata")
    table = file.read()
    row, seed, metric, draw, value = (table[name].to_numpy() for name in COLUMNS.names)
    first = np.flatnonzero(draw == 0)
    ends = [*first[1:], len(draw)]
    scores = [
        Score(str(row[i]), int(seed[i]), str(metric[i]), np.array(value[i:end]))
        for i, end in zip(first, ends, strict=True)
    ]
    facts: dict[str, Any] = json.loads(text)
    return scores, facts
