"""The history of decisions: a JSON file a decision, and one Parquet table made of them all.

The JSON files are the truth, each written whole and never again touched; the table is made anew
from them each time, so that a broken table costs nothing. Decisions are numbered, and read in the
order of their numbers: a clock may jump.
"""

import json
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from pacmo_core.store.atomic import whole_file, write_text
from pacmo_core.store.schema import VERSION

TABLE = "decisions.parquet"
PROMOTED, HELD, UNCHANGED, ROLLED_BACK = "promoted", "held", "unchanged", "rolled back"


@dataclass(frozen=True, kw_only=True)
class Decision:
    """One decision about one candidate.

    Parameters
    ----------
    number : from 1, rising
    at : UTC, ISO 8601
    verdict : ``promoted``, ``held``, ``unchanged`` or ``rolled back``
    reasons : why it was held, or what was rolled back
    model : SHA-256 of the candidate's weights
    shelf : number on the shelf of what is current after the decision; 0 for none
    experiment : its name
    test_reactions : how many reactions the metrics rest on
    metrics : mean, low and high of every metric that the gate looks at
    """

    number: int
    at: str
    verdict: str
    reasons: tuple[str, ...]
    model: str
    shelf: int
    experiment: str
    test_reactions: int
    metrics: dict[str, dict[str, float]]


@dataclass(frozen=True)
class Broken:
    """A file among the decisions that cannot be read, and why."""

    file: Path
    reason: str


def read_decisions(folder: Path) -> tuple[list[Decision], list[Broken]]:
    """Read all decisions in the order of their numbers, and name the files that are broken."""
    decisions, broken = [], []
    for file in sorted(folder.glob("[0-9]*.json")):
        try:
            decisions.append(_from_json(json.loads(file.read_text(encoding="utf-8"))))
        except (ValueError, TypeError) as fault:
            broken.append(Broken(file, str(fault)))
    return sorted(decisions, key=lambda decision: decision.number), broken


def next_number(folder: Path) -> int:
    """Give the number after the last, broken files counted."""
    return max((int(file.stem) for file in folder.glob("[0-9]*.json")), default=0) + 1


def add_decision(folder: Path, decision: Decision) -> None:
    """Write a decision down, and the table anew.

    Raises
    ------
    FileExistsError
        If there is a decision of that number.
    """
    path = folder / f"{decision.number:06d}.json"
    if path.exists():
        raise FileExistsError(f"{path}: a decision is written once")
    write_text(path, json.dumps(asdict(decision), indent=2, allow_nan=False) + "\n")
    write_table(folder)


def write_table(folder: Path) -> Path:
    """Make the Parquet table from the decisions: a row a decision, metrics as a list of structs."""
    decisions, _ = read_decisions(folder)
    cell = pa.struct(
        [("metric", pa.string()), *((n, pa.float64()) for n in ("mean", "low", "high"))]
    )
    kinds: dict[str, pa.DataType] = {
        **dict.fromkeys(("number", "shelf", "test_reactions"), pa.int64()),
        "reasons": pa.list_(pa.string()),
        "metrics": pa.list_(cell),
    }
    names = [field.name for field in fields(Decision)]
    schema = pa.schema(
        [(name, kinds.get(name, pa.string())) for name in names], metadata={"pacmo": VERSION}
    )
    rows = [{**asdict(decision), "metrics": _cells(decision)} for decision in decisions]
    path = folder / TABLE
    with whole_file(path) as partial:
        pq.write_table(pa.Table.from_pylist(rows, schema=schema), partial, compression="zstd")
    return path


def _cells(decision: Decision) -> list[dict[str, Any]]:
    return [{"metric": name, **cell} for name, cell in decision.metrics.items()]


def _from_json(facts: Any) -> Decision:
    if not isinstance(facts, dict):
        raise TypeError(f"wanted an object, got {type(facts).__name__}")
    return Decision(**{**facts, "reasons": tuple(facts.get("reasons", ()))})
