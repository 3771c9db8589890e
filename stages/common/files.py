"""The files that stages exchange: their names, JSON and training curves."""

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
SOLVER = "solver.json"  # settings of the solver that made a dataset of variations
SCRIPTS = "scripts.json"  # of the synthetic captures; recorded ones have none
ALL_SOURCES = "all"  # key of the mean over sources
# Rows of the table of skeleton priors that are not trained: a copy of the source, and the rule.
TEMPLATE, START = "template", "start"


def write_json(path: Path, facts: Mapping[str, Any]) -> None:
    """Write indented JSON, which ``dvc metrics`` can compare."""
    write_text(path, json.dumps(facts, indent=2, allow_nan=False) + "\n")


def read_json(path: Path) -> dict[str, Any]:
    """Read a JSON object."""
    facts: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return facts


def write_curve(path: Path, rows: Iterable[Mapping[str, float]]) -> None:
    """Write a training curve as ``dvc plots`` reads it: a column for each term."""
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
    """Return the address of the Dask scheduler; empty for processes of this machine."""
    return os.environ.get(SCHEDULER, "")
