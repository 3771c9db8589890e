"""The files that stages hand to each other: their names in a folder, tables of facts and curves."""

import csv
import io
import json
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from pacmo_core.store.files import write_text

MOTIONS = "motions.parquet"
CLIPS = "clips.parquet"
QUARANTINE = "quarantine.parquet"
WEIGHTS = "weights.safetensors"
LAW = "law.json"
ALL_SOURCES = "all"  # the mean over sources, beside each source's own figures


def write_json(path: Path, facts: Mapping[str, Any]) -> None:
    """Write facts as JSON that a person can read and ``dvc metrics`` can compare."""
    write_text(path, json.dumps(facts, indent=2, allow_nan=False) + "\n")


def read_json(path: Path) -> dict[str, Any]:
    """Read facts back."""
    facts: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return facts


def write_curve(path: Path, rows: Iterable[Mapping[str, float]]) -> None:
    """Write a training curve, a column a term, as ``dvc plots`` reads it."""
    rows = list(rows)
    text = io.StringIO()
    table = csv.DictWriter(text, fieldnames=list(rows[0]), lineterminator="\n")
    table.writeheader()
    table.writerows({key: f"{value:.6g}" for key, value in row.items()} for row in rows)
    write_text(path, text.getvalue())


def read_curve(path: Path) -> dict[str, list[float]]:
    """Read a training curve as columns."""
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    return {key: [float(row[key]) for row in rows] for key in rows[0]}


SCHEDULER = "DASK_SCHEDULER_ADDRESS"


def scheduler_address() -> str:
    """Give the address that the environment names; empty means this machine's processes."""
    return os.environ.get(SCHEDULER, "")
