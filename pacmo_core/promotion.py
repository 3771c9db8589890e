"""Promotion: which trained model is the current one.

- The *gate* compares the metrics of a new model with the current one's and lists the reasons
  against its promotion: ``check_gate``. Tolerances are the intervals of the current metrics.
- The *history* is a JSON file for each decision, and one Parquet table of all: ``add_decision``.
  The JSON files are written once; the table is made from them again after each decision.
  Decisions are in the order of their numbers, as clocks may jump.
- *Promoted models* are copied to a numbered folder each: ``prepare_model`` before the decision is
  written, ``publish_model`` after it. DVC does not manage the copies, so that pruning its cache
  deletes no promoted model. ``current`` is a symbolic link to one of the folders, replaced in one
  step: a reader finds the old model or the new one, complete.
"""

import json
import math
import shutil
import sys
from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, TypeGuard

import pyarrow as pa
import pyarrow.parquet as pq

from pacmo_core.metrics.catalogue import CLOSER_TO_REAL, HIGHER, LOWER, METRICS
from pacmo_core.store.files import atomic_file, file_hash, fsync, write_text
from pacmo_core.store.parquet import VERSION

Interval = Mapping[str, float]  # mean, low, high
Metrics = Mapping[str, Interval]
INTERVAL = ("mean", "low", "high")


@dataclass(frozen=True, kw_only=True)
class Gate:
    """The conditions of a promotion: the section ``nightly.gate`` of ``params.yaml``.

    Parameters
    ----------
    row : row of the tables that is compared, such as ``pacmo``
    metrics : metrics that may not become worse
    max_noise_floor_ratio : maximum of F²ID over its noise floor, the F²ID between two samples of
        real motion
    """

    row: str
    metrics: tuple[str, ...]
    max_noise_floor_ratio: float

    def __post_init__(self) -> None:
        if not 0 < self.max_noise_floor_ratio < math.inf:
            raise ValueError(
                f"max_noise_floor_ratio must be positive; got {self.max_noise_floor_ratio}"
            )


def check_gate(
    candidate: Mapping[str, Metrics], current: Mapping[str, Metrics] | None, gate: Gate
) -> list[str]:
    """List the reasons against the promotion of a candidate; empty if it may be promoted.

    A metric is worse beyond its tolerance where the mean of the candidate is outside the interval
    of the current model, on the bad side. A metric that should be close to that of real motion is
    compared by its distance to the row ``real`` of the same table. A metric that is no finite
    number, or whose interval is none, is a reason: no comparison with it has a meaning. So is one
    that the current model has and the candidate lacks; captures without contact, or of few people,
    lack some metrics in both.

    Parameters
    ----------
    candidate, current : tables of metrics by row; ``current`` is None before the first promotion.
        Metrics that the table of the current model lacks are not compared
    """
    required = {"f2id", "f2id_floor", *(current or {}).get(gate.row, {})}
    reasons = [*_unusable(candidate, gate, "", required)]
    if current is not None:
        reasons += _unusable(current, gate, "the current model's ", set())
    if reasons:
        return reasons
    reasons = _noise_floor_reasons(candidate[gate.row], gate)
    return reasons + _degradations(candidate, current, gate)


def compared_metrics(table: Mapping[str, Metrics], gate: Gate) -> dict[str, dict[str, float]]:
    """Return the metrics of the gate's row that a decision records: those that are finite."""
    metrics = table.get(gate.row, {})
    return {
        name: {part: metrics[name][part] for part in INTERVAL}
        for name in _names(gate)
        if _is_interval(metrics.get(name))
    }


def _names(gate: Gate) -> tuple[str, ...]:
    return tuple(dict.fromkeys((*gate.metrics, "f2id", "f2id_floor")))


def _unusable(
    table: Mapping[str, Metrics], gate: Gate, whose: str, required: Container[str]
) -> Iterator[str]:
    """Yield what is wrong with a table whose comparison would have no meaning."""
    for name in _names(gate):
        rows = ["real"] if _is_compared_with_real(name) else []
        for row in (gate.row, *rows):
            interval = table.get(row, {}).get(name)
            label = METRICS[name].label if name in METRICS else name
            if interval is None:
                if name in required:
                    yield f"{label} of {row} is missing"
            elif not _is_estimate(interval):
                yield f"{whose}{label} of {row} is no finite interval: {_format_parts(interval)}"


def _is_compared_with_real(name: str) -> bool:
    return name in METRICS and METRICS[name].better == CLOSER_TO_REAL


def _degradations(
    candidate: Mapping[str, Metrics], current: Mapping[str, Metrics] | None, gate: Gate
) -> list[str]:
    if current is None:
        return []
    reasons = []
    for name in gate.metrics:
        if not _is_interval(current.get(gate.row, {}).get(name)):
            continue  # a metric added since then, or of too few units
        if _is_compared_with_real(name) and not _is_interval(current.get("real", {}).get(name)):
            continue  # nothing to compare distances with
        reason = _degradation(name, candidate, current, gate.row)
        reasons += [reason] if reason else []
    return reasons


def _noise_floor_reasons(metrics: Metrics, gate: Gate) -> list[str]:
    f2id, floor = metrics["f2id"]["mean"], metrics["f2id_floor"]["mean"]
    if f2id <= gate.max_noise_floor_ratio * floor < math.inf:
        return []
    ratio = gate.max_noise_floor_ratio
    return [
        f"F²ID {f2id:.4g} is above {ratio:g} times its noise floor {floor:.4g}, "
        f"that is {ratio * floor:.4g}"
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
    if _is_compared_with_real(name):
        real = [table["real"][name]["mean"] for table in (candidate, current)]
        distance, current_distance = abs(new["mean"] - real[0]), abs(old["mean"] - real[1])
        tolerance = max(old["high"] - old["mean"], old["mean"] - old["low"])
        if distance > current_distance + tolerance:
            return (
                f"{label} is {distance:.4g} from real motion's; "
                f"current {current_distance:.4g} ± {tolerance:.4g}"
            )
    return ""


def _format_interval(interval: Interval) -> str:
    return f"{interval['mean']:.4g} ({interval['low']:.4g} to {interval['high']:.4g})"


def _format_parts(interval: object) -> str:
    if isinstance(interval, Mapping) and set(INTERVAL) <= set(interval):
        return ", ".join(f"{part} {str(interval[part])[:20]}" for part in INTERVAL)
    return f"{interval!s:.60}"


CURRENT_LINK = "current"
TABLE = "decisions.parquet"
PROMOTED, REJECTED, UNCHANGED, ROLLED_BACK = "promoted", "rejected", "unchanged", "rolled back"
VERDICTS = (PROMOTED, REJECTED, UNCHANGED, ROLLED_BACK)


@dataclass(frozen=True, kw_only=True)
class Decision:
    """One decision about one candidate.

    Parameters
    ----------
    number : 1, 2, 3, ...
    at : UTC, ISO 8601
    verdict : ``promoted``, ``rejected``, ``unchanged`` or ``rolled back``
    reasons : why it was rejected, or what was rolled back
    model : SHA-256 of the candidate's weights
    current_model : number of the model that is current after the decision; 0 for none
    experiment : its name
    test_reactions : number of reactions that the metrics were computed from
    metrics : mean, low and high of every metric of the gate
    """

    number: int
    at: str
    verdict: str
    reasons: tuple[str, ...]
    model: str
    current_model: int
    experiment: str
    test_reactions: int
    metrics: dict[str, dict[str, float]]

    def __post_init__(self) -> None:
        wrong = [name for name, is_right in _checks(vars(self)).items() if not is_right]
        if wrong:
            raise ValueError("; ".join(f"{name} is {getattr(self, name)!r}" for name in wrong))


@dataclass(frozen=True)
class UnreadableDecision:
    """A file of the history that cannot be read, and why."""

    file: Path
    reason: str


def read_decisions(folder: Path) -> tuple[list[Decision], list[UnreadableDecision]]:
    """Read all decisions in the order of their numbers, and list the unreadable files."""
    decisions, unreadable = [], []
    for file in sorted(folder.glob("[0-9]*.json")):
        try:
            decisions.append(_read_decision(file))
        except (ValueError, TypeError) as error:
            unreadable.append(UnreadableDecision(file, str(error)))
    return sorted(decisions, key=lambda decision: decision.number), unreadable


def next_number(folder: Path) -> int:
    """Return the next number; unreadable files count, and those that were set aside."""
    return max((int(f.stem) for f in folder.glob("[0-9]*.*") if f.stem.isdecimal()), default=0) + 1


def add_decision(folder: Path, decision: Decision) -> None:
    """Write a decision, and the table of all again.

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
    """Write the Parquet table of all decisions, a row each; metrics are a list of structs."""
    decisions, _ = read_decisions(folder)
    interval = pa.struct([("metric", pa.string()), *((n, pa.float64()) for n in INTERVAL)])
    types: dict[str, pa.DataType] = {
        **dict.fromkeys(("number", "current_model", "test_reactions"), pa.int64()),
        "reasons": pa.list_(pa.string()),
        "metrics": pa.list_(interval),
    }
    names = [field.name for field in fields(Decision)]
    schema = pa.schema(
        [(name, types.get(name, pa.string())) for name in names], metadata={"pacmo": VERSION}
    )
    rows = [{**asdict(decision), "metrics": _metric_rows(decision)} for decision in decisions]
    path = folder / TABLE
    with atomic_file(path) as partial:
        pq.write_table(pa.Table.from_pylist(rows, schema=schema), partial, compression="zstd")
    return path


def _metric_rows(decision: Decision) -> list[dict[str, Any]]:
    return [{"metric": name, **interval} for name, interval in decision.metrics.items()]


def _read_decision(file: Path) -> Decision:
    content = json.loads(file.read_text(encoding="utf-8"))
    if not isinstance(content, dict):
        raise TypeError(f"wanted an object, got {type(content).__name__}")
    reasons = content.get("reasons")
    if not isinstance(reasons, list):
        raise TypeError(f"reasons is {reasons!r:.60}")
    decision = Decision(**{**content, "reasons": tuple(reasons)})
    if f"{decision.number:06d}" != file.stem:
        raise ValueError(f"number is {decision.number}")
    return decision


def _checks(values: Mapping[str, Any]) -> dict[str, bool]:
    """Return whether each field has a value that it can have: a file may hold any."""
    texts = ("at", "model", "experiment")
    numbers = ("number", "current_model", "test_reactions")
    reasons, metrics = values["reasons"], values["metrics"]
    return {
        **{name: _is_text(values[name]) for name in texts},
        **{name: is_count(values[name]) for name in numbers},
        "verdict": values["verdict"] in VERDICTS,
        "reasons": isinstance(reasons, tuple) and all(map(_is_text, reasons)),
        "metrics": isinstance(metrics, dict)
        and all(_is_interval(x) and set(x) == set(INTERVAL) for x in metrics.values()),
    }


def _is_text(value: object) -> bool:
    """Whether a value can be written and shown: controls and surrogates cannot."""
    return isinstance(value, str) and value.isprintable()


def is_count(value: object) -> TypeGuard[int]:
    """Whether a value is a whole number that a table can hold."""
    return type(value) is int and 0 <= value < 1 << 63


def _is_estimate(value: object) -> bool:
    """Whether a value is a finite mean alone, of too few units for an interval, or an interval."""
    if isinstance(value, Mapping) and set(INTERVAL) & set(value) == {"mean"}:
        return _is_interval(dict.fromkeys(INTERVAL, value["mean"]))
    return _is_interval(value)


def _is_interval(value: object) -> bool:
    """Whether a value has the parts of ``INTERVAL``, all finite numbers."""
    if not isinstance(value, Mapping) or not set(INTERVAL) <= set(value):
        return False
    parts = [value[part] for part in INTERVAL]
    return all(type(x) in (int, float) and abs(x) <= sys.float_info.max for x in parts)


def model_hash(files: Sequence[Path]) -> str:
    """Compute the SHA-256 of files of weights, one after the other."""
    if not files:
        raise ValueError("a model is at least one file of weights; got none")
    return file_hash(*files)


def prepare_model(models: Path, number: int, files: Mapping[str, Path]) -> None:
    """Copy the files of a model into a hidden folder, which ``publish_model`` renames.

    What other models were prepared and never published, by killed runs, is removed.

    Parameters
    ----------
    models : the folder of all promoted models
    number : of the decision that promotes the model
    files : source files, by the path of the copy

    Raises
    ------
    FileExistsError
        If there is a model of that number.
    """
    if (models / f"{number:06d}").exists():
        raise FileExistsError(f"{models / f'{number:06d}'}: a promoted model is written once")
    remove_prepared_models(models)
    partial = models / f".{number:06d}"
    for name, file in files.items():
        (partial / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, partial / name)
        fsync(partial / name)


def publish_model(models: Path, number: int) -> None:
    """Give a prepared model its place; nothing happens if it has it already."""
    partial = models / f".{number:06d}"
    if partial.exists():
        partial.replace(models / f"{number:06d}")
        fsync(models)


def remove_prepared_models(models: Path) -> None:
    """Remove models that were never published."""
    for partial in models.glob(".[0-9]*"):
        shutil.rmtree(partial)


def list_models(models: Path) -> list[int]:
    """List the numbers of the promoted models."""
    return sorted(int(path.name) for path in models.glob("[0-9]*") if path.is_dir())


def current_model(models: Path) -> int:
    """Return the number of the current model; 0 if there is none."""
    link = models / CURRENT_LINK
    return int(link.readlink().name) if link.is_symlink() else 0


def set_current_model(models: Path, number: int) -> None:
    """Point ``current`` to a promoted model.

    Raises
    ------
    FileNotFoundError
        If there is no model of that number.
    """
    name = f"{number:06d}"
    if not (models / name).is_dir():
        raise FileNotFoundError(f"{models}: no model {name}; there are {list_models(models)}")
    partial = models / f".{CURRENT_LINK}"
    partial.unlink(missing_ok=True)
    partial.symlink_to(name)
    partial.replace(models / CURRENT_LINK)
    fsync(models)


def remove_model(models: Path, number: int) -> None:
    """Delete a promoted model.

    Raises
    ------
    ValueError
        If it is the current one.
    """
    if number == current_model(models):
        raise ValueError(f"{models}: model {number} is current")
    shutil.rmtree(models / f"{number:06d}")
