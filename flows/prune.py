"""Remove what is old and not needed.

The rule, with its numbers in the section ``prune`` of ``params.yaml``: DVC's cache loses what is
older than ``max_cache_days`` and is named neither in ``dvc.lock`` nor in that of a promoted model;
the folder of promoted models all but the last ``n_promoted`` and the current one; the records of
runs all but the last ``n_runs``. Decisions and quarantined captures are never removed.
"""

import json
import re
import time
from dataclasses import dataclass
from pathlib import Path

from prefect import flow
from ruamel.yaml import YAML

from flows.reproduce import publish_table, run_step
from pacmo_core import promotion
from pacmo_core.project.lock import writer_lock
from pacmo_core.project.objects import OBJECTS, cache_objects, object_hash
from pacmo_core.project.records import RunRecord, record_run
from pacmo_core.project.workspace import (
    DVC_CACHE,
    DVC_LOCK,
    LOCK,
    PROMOTED_MODELS,
    RUNS,
    configure_logging,
    log_event,
)
from stages.common.params import read_params

RUN_CACHE = DVC_CACHE / "runs"
_HASH = re.compile(r"\b[0-9a-f]{32}(?:\.dir)?\b")
_DAY_S = 86400.0


@dataclass(frozen=True)
class Params:
    """The ``prune`` section of ``params.yaml``.

    Parameters
    ----------
    max_cache_days : age from which objects of DVC's cache are removed
    n_runs, n_promoted : records of runs and promoted models that stay
    """

    max_cache_days: float
    n_runs: int
    n_promoted: int

    def __post_init__(self) -> None:
        for name in ("max_cache_days", "n_runs", "n_promoted"):
            if getattr(self, name) < 0:
                raise ValueError(f"{name} must be at least 0; got {getattr(self, name)}")


@flow(persist_result=False)
def prune() -> None:
    """Remove what is old and not needed."""
    run_prune()


def run_prune() -> RunRecord:
    """Prune, within a flow, as the only writer."""
    configure_logging()
    with writer_lock("prune", LOCK), record_run("prune", RUNS) as run:
        params = read_params("prune", Params)
        run.facts["promoted"] = run_step(remove_models, params.n_promoted)
        locks = [DVC_LOCK, *sorted(PROMOTED_MODELS.glob(f"[0-9]*/{DVC_LOCK}"))]
        n_objects, n_bytes = run_step(remove_old_objects, params.max_cache_days, locks)
        run.facts |= {"objects": n_objects, "bytes": n_bytes}
        run.facts["runs"] = run_step(remove_records, params.n_runs)
        publish_table("prune", [run.facts], "What was removed")
        log_event(f"removed {n_objects} objects, {n_bytes / 1e6:.0f} MB", **run.facts)
    return run


def remove_models(n_last: int) -> list[int]:
    """Remove promoted models except the last and the current one; return their numbers."""
    current = promotion.current_model(PROMOTED_MODELS)
    numbers = promotion.list_models(PROMOTED_MODELS)
    numbers = numbers[: max(0, len(numbers) - n_last)]
    removed = [number for number in numbers if number != current]
    for number in removed:
        promotion.remove_model(PROMOTED_MODELS, number)
    return removed


def remove_records(n_last: int) -> int:
    """Remove records of runs except the last; return how many."""
    records = sorted(RUNS.glob("[0-9]*.json"))
    removed = records[: max(0, len(records) - n_last)]
    for path in removed:
        path.unlink()
    return len(removed)


def remove_old_objects(max_days: float, locks: list[Path]) -> tuple[int, int]:
    """Remove old objects, and entries of the run cache, that no lock file names.

    Parameters
    ----------
    max_days : age from which they are removed
    locks : ``dvc.lock`` files; what they name stays, whatever its age

    Returns
    -------
    number of objects, and of bytes
    """
    named = {name for lock in locks if lock.exists() for name in _hashes_in(lock)}
    named |= {name for folder in named if folder.endswith(".dir") for name in _members(folder)}
    old = [p for p in cache_objects() if _is_old(p, max_days) and object_hash(p) not in named]
    n_bytes = sum(path.stat().st_size for path in old)
    for path in old:
        path.unlink()
    for path in RUN_CACHE.glob("*/*/*"):
        if path.is_file() and _is_old(path, max_days):
            path.unlink()
    return len(old), n_bytes


def _is_old(path: Path, max_days: float) -> bool:
    # A modification time in the future, of a clock that was set back, counts as recent.
    return time.time() - path.stat().st_mtime > max_days * _DAY_S


def _hashes_in(lock: Path) -> set[str]:
    stages = YAML(typ="safe").load(lock)
    return set(_HASH.findall(json.dumps(stages)))


def _members(folder: str) -> list[str]:
    path = OBJECTS / folder[:2] / folder[2:]
    if not path.exists():
        return []
    return [entry["md5"] for entry in json.loads(path.read_text(encoding="utf-8"))]
