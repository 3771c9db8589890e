"""Remove what is old and not needed.

    python -m flows.prune

The rule, its numbers in the section ``prune`` of ``params.yaml``: of DVC's cache goes what is
older than ``cache_days`` and named by neither the workspace's ``dvc.lock`` nor that of a model on
the shelf; of the shelf what is not among its last ``promoted`` nor current; of the records of runs
all but the last ``runs``. Decisions are never removed, nor what was put aside from the inbox.
"""

import hashlib
import json
import os
import re
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from prefect import flow
from ruamel.yaml import YAML

from flows.artifacts import put_table
from flows.ending import by_hand_or_flow
from flows.way import ByHand, ByPrefect, Way
from pacmo_core import promotion
from pacmo_core.project.lock import writer_lock
from pacmo_core.project.records import RunRecord, record_run
from pacmo_core.project.workspace import (
    DVC_CACHE,
    DVC_LOCK,
    LOCK,
    LOG,
    PROMOTED_MODELS,
    RUNS,
    configure_logging,
    log_event,
)
from stages.common.params import read_params


@dataclass(frozen=True)
class Params:
    """The ``prune`` section of ``params.yaml``."""

    cache_days: float
    runs: int
    promoted: int


def run_prune(way: Way) -> RunRecord:
    """Prune as the only writer."""
    configure_logging(LOG)
    with writer_lock("prune", LOCK), record_run("prune", RUNS) as run:
        params = read_params("prune", Params)
        run.facts["promoted"] = way.step(remove_models, params.promoted)
        locks = [Path(DVC_LOCK), *sorted(PROMOTED_MODELS.glob(f"[0-9]*/{DVC_LOCK}"))]
        objects, size = way.step(remove_old_objects, params.cache_days, locks)
        run.facts |= {"objects": objects, "bytes": size}
        run.facts["runs"] = way.step(remove_records, params.runs)
        put_table("prune", [run.facts], "What was removed")
        log_event(f"pruned {objects} objects, {size / 1e6:.0f} MB", **run.facts)
    return run


def remove_models(keep: int) -> list[int]:
    """Remove promoted models but for the last and the current one."""
    now_current = promotion.current_model(PROMOTED_MODELS)
    old = [
        number for number in promotion.list_models(PROMOTED_MODELS)[:-keep] if number != now_current
    ]
    for number in old:
        promotion.remove_model(PROMOTED_MODELS, number)
    return old


def remove_records(keep: int) -> int:
    """Remove records of runs but for the last."""
    old = sorted(RUNS.glob("[0-9]*.json"))[:-keep]
    for path in old:
        path.unlink()
    return len(old)


@flow(persist_result=False)
def prune() -> None:
    """Remove what is old and not needed."""
    run_prune(ByPrefect())


def main() -> int:
    """Prune."""
    return by_hand_or_flow(prune, lambda: run_prune(ByHand(workers=1)))


if __name__ == "__main__":
    raise SystemExit(main())


# FROM """DVC's cache: find objects that are no longer what their names say, and remove old ones.
# FROM
# FROM DVC trusts an object that is write-protected and does not hash it again, so that one which a disk
# FROM has spoilt would be handed out for ever.
# FROM """
OBJECTS = DVC_CACHE / "files" / "md5"
RUN_CACHE = DVC_CACHE / "runs"
_HASH = re.compile(r"\b[0-9a-f]{32}(?:\.dir)?\b")
_DAY = 86400.0


def corrupt_objects() -> list[Path]:
    """List the objects whose content is not that of their name."""
    return [path for path in _objects() if _md5(path) != _name_of(path).removesuffix(".dir")]


def remove_corrupt_objects() -> list[str]:
    """Remove spoilt objects, and have DVC look again at the files of the workspace that they are.

    Those are links to the same content, with the size and time that DVC remembers: a new time
    makes it hash them, and make them anew.

    Returns
    -------
    their names
    """
    found = corrupt_objects()
    for path in found:
        os.utime(path)
        path.unlink()
    return [_name_of(path) for path in found]


def remove_old_objects(days: float, locks: list[Path]) -> tuple[int, int]:
    """Remove objects and remembered runs that are older and that no lock file names.

    Parameters
    ----------
    days : age from which they go
    locks : ``dvc.lock`` files; what they name stays, whatever its age

    Returns
    -------
    how many objects, and how many bytes
    """
    kept = {name for lock in locks if lock.exists() for name in _names_in(lock)}
    kept |= {name for folder in kept if folder.endswith(".dir") for name in _members(folder)}
    old = [path for path in _objects() if _is_old(path, days) and _name_of(path) not in kept]
    size = sum(path.stat().st_size for path in old)
    for path in old:
        path.unlink()
    for path in RUN_CACHE.glob("*/*/*"):
        if path.is_file() and _is_old(path, days):
            path.unlink()
    return len(old), size


def _objects() -> Iterator[Path]:
    return (path for path in sorted(OBJECTS.glob("[0-9a-f][0-9a-f]/*")) if path.is_file())


def _name_of(path: Path) -> str:
    return path.parent.name + path.name


def _md5(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "md5").hexdigest()


def _is_old(path: Path, days: float) -> bool:
    # A time to come, which a clock that jumped has left, counts as young.
    return time.time() - path.stat().st_mtime > days * _DAY


def _names_in(lock: Path) -> set[str]:
    stages = YAML(typ="safe").load(lock)
    return set(_HASH.findall(json.dumps(stages)))


def _members(folder: str) -> list[str]:
    path = OBJECTS / folder[:2] / folder[2:]
    if not path.exists():
        return []
    return [entry["md5"] for entry in json.loads(path.read_text(encoding="utf-8"))]
