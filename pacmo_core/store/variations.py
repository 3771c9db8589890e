"""The facts beside the variations: a row each, with its bodies and its report.

Bodies are structs with a field a segment, in the order of the skeleton's bones.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from pacmo_core.store.atomic import whole_file
from pacmo_core.store.schema import VERSION, StoreError, check_version, open_parquet

# Names in a family's folder: folders of the variations that are kept, of those beyond a limit and
# of the clips that were varied, a file a clip; and the facts of all.
GOOD = "motions"
FAILED = "failed"
SOURCES = "sources"
VARIATIONS = "variations.parquet"

PLAIN = ("variation", "clip", "kind", "kept", "reason", "badness")
SCALES = ("scales_a", "scales_b")


@dataclass(frozen=True)
class VariationFacts:
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


def write_variations(path: Path, rows: Sequence[VariationFacts], segments: Sequence[str]) -> None:
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
    with whole_file(path) as partial:
        table = pa.Table.from_pylist([_flat(row) for row in rows], schema=schema)
        pq.write_table(table, partial, compression="zstd")


def read_variations(path: Path) -> list[VariationFacts]:
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


def _flat(row: VariationFacts) -> dict[str, Any]:
    plain = {name: getattr(row, name) for name in (*PLAIN, *SCALES)}
    return plain | row.figures


def _fact(row: dict[str, Any], figures: list[str]) -> VariationFacts:
    found = {name: row[name] for name in figures if row[name] is not None}
    return VariationFacts(figures=found, **{name: row[name] for name in (*PLAIN, *SCALES)})
