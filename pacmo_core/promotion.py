"""May a newly trained model become current? Every reason against it, in words."""

import hashlib
import json
import os
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from pacmo_core.figures.columns import CLOSER, HIGHER, LOWER, METRICS
from pacmo_core.store.files import atomic_file, write_text
from pacmo_core.store.tables import VERSION

Interval = Mapping[str, float]  # mean, low, high
Metrics = Mapping[str, Interval]


@dataclass(frozen=True, kw_only=True)
class Gate:
    """What a model must keep to.

    Parameters
    ----------
    row : the row of the table that is judged
    metrics : the metrics that may not become worse
    most_floors : F²ID may be at most so many times its floor, what two draws of real motion give
    """

    row: str
    metrics: tuple[str, ...]
    most_floors: float


def check_gate(
    candidate: Mapping[str, Metrics], current: Mapping[str, Metrics] | None, gate: Gate
) -> list[str]:
    """Say why a model is not to become current; nothing if it may.

    A metric is worse by more than its interval where the candidate's mean lies beyond the bad end
    of the current model's interval. A metric that is better closer to real motion is held by its
    distance to the row ``real``, each in its own table.

    Parameters
    ----------
    candidate, current : tables of metrics by row; there is no current one on the first night

    Raises
    ------
    KeyError
        If the candidate's table lacks the row or one of the metrics.
    """
    found = _noise_floor_reasons(candidate[gate.row], gate)
    if current is None:
        return found
    for name in gate.metrics:
        if name not in current.get(gate.row, {}):
            continue  # a metric that is new tonight has nothing to be worse than
        reason = _degradation(name, candidate, current, gate.row)
        found += [reason] if reason else []
    return found


def _noise_floor_reasons(metrics: Metrics, gate: Gate) -> list[str]:
    f2id, floor = metrics["f2id"]["mean"], metrics["f2id_floor"]["mean"]
    if f2id <= gate.most_floors * floor:
        return []
    return [
        f"F²ID {f2id:.4g} is above {gate.most_floors:g} times its floor {floor:.4g}, "
        f"that is {gate.most_floors * floor:.4g}"
    ]


def _degradation(
    name: str, candidate: Mapping[str, Metrics], current: Mapping[str, Metrics], row: str
) -> str:
    new, old = candidate[row][name], current[row][name]
    better = METRICS[name].better
    label = METRICS[name].label
    if better == LOWER and new["mean"] > old["high"]:
        return f"{label} rose to {new['mean']:.4g}; current {_format_interval(old)}"
    if better == HIGHER and new["mean"] < old["low"]:
        return f"{label} fell to {new['mean']:.4g}; current {_format_interval(old)}"
    if better == CLOSER:
        goals = [table["real"][name]["mean"] for table in (candidate, current)]
        away, was_away = abs(new["mean"] - goals[0]), abs(old["mean"] - goals[1])
        # The interval's longer arm: its reach from the mean towards either side.
        reach = max(old["high"] - old["mean"], old["mean"] - old["low"])
        if away > was_away + reach:
            return f"{label} is {away:.4g} from real motion's; current {was_away:.4g} ± {reach:.4g}"
    return ""


def _format_interval(cell: Interval) -> str:
    return f"{cell['mean']:.4g} ({cell['low']:.4g} to {cell['high']:.4g})"


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
class UnreadableDecision:
    """A file among the decisions that cannot be read, and why."""

    file: Path
    reason: str


def read_decisions(folder: Path) -> tuple[list[Decision], list[UnreadableDecision]]:
    """Read all decisions in the order of their numbers, and name the files that are broken."""
    decisions, broken = [], []
    for file in sorted(folder.glob("[0-9]*.json")):
        try:
            decisions.append(_from_json(json.loads(file.read_text(encoding="utf-8"))))
        except (ValueError, TypeError) as fault:
            broken.append(UnreadableDecision(file, str(fault)))
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
    with atomic_file(path) as partial:
        pq.write_table(pa.Table.from_pylist(rows, schema=schema), partial, compression="zstd")
    return path


def _cells(decision: Decision) -> list[dict[str, Any]]:
    return [{"metric": name, **cell} for name, cell in decision.metrics.items()]


def _from_json(facts: Any) -> Decision:
    if not isinstance(facts, dict):
        raise TypeError(f"wanted an object, got {type(facts).__name__}")
    return Decision(**{**facts, "reasons": tuple(facts.get("reasons", ()))})


CURRENT_LINK = "current"


def model_hash(files: Sequence[Path]) -> str:
    """SHA-256 of files of weights, in order."""
    if not files:
        raise ValueError("a model is at least one file of weights; got none")
    digest = hashlib.sha256()
    for file in files:
        digest.update(file.read_bytes())
    return digest.hexdigest()


def store_model(shelf: Path, number: int, files: Mapping[str, Path]) -> Path:
    """Copy files into a new folder of the shelf, whole or not at all.

    Parameters
    ----------
    shelf : the folder of all
    number : of the decision that promotes them
    files : what to copy, by the path that it gets

    Raises
    ------
    FileExistsError
        If the shelf has that number.
    """
    place = shelf / f"{number:06d}"
    if place.exists():
        raise FileExistsError(f"{place}: what is on the shelf stays as it is")
    partial = shelf / f".{place.name}"
    if partial.exists():
        shutil.rmtree(partial)  # a killed run's
    for name, file in files.items():
        (partial / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, partial / name)
        _sync(partial / name)
    partial.replace(place)
    _sync(shelf)
    return place


def list_models(shelf: Path) -> list[int]:
    """List what is on the shelf."""
    return sorted(int(place.name) for place in shelf.glob("[0-9]*") if place.is_dir())


def current_model(shelf: Path) -> int:
    """Give the number of the current model; 0 if none is."""
    link = shelf / CURRENT_LINK
    return int(link.readlink().name) if link.is_symlink() else 0


def set_current_model(shelf: Path, number: int) -> None:
    """Point ``current`` to a folder of the shelf.

    Raises
    ------
    FileNotFoundError
        If the shelf has no such number.
    """
    name = f"{number:06d}"
    if not (shelf / name).is_dir():
        raise FileNotFoundError(f"{shelf} holds no {name}; it holds {list_models(shelf)}")
    partial = shelf / f".{CURRENT_LINK}"
    partial.unlink(missing_ok=True)
    partial.symlink_to(name)
    partial.replace(shelf / CURRENT_LINK)
    _sync(shelf)


def remove_model(shelf: Path, number: int) -> None:
    """Take a folder off the shelf.

    Raises
    ------
    ValueError
        If it is current.
    """
    if number == current_model(shelf):
        raise ValueError(f"{shelf}: {number} is current")
    shutil.rmtree(shelf / f"{number:06d}")


def _sync(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
