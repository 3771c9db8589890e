"""Remove what is old and not needed.

    python -m flows.prune

The rule, its numbers in the section ``prune`` of ``params.yaml``: of DVC's cache goes what is
older than ``cache_days`` and named by neither the workspace's ``dvc.lock`` nor that of a model on
the shelf; of the shelf what is not among its last ``promoted`` nor current; of the records of runs
all but the last ``runs``. Decisions are never removed, nor what was put aside from the inbox.
"""

from dataclasses import dataclass
from pathlib import Path

from prefect import flow

from apps.lock import one_writer
from apps.log import start_log, tell
from apps.places import LOCK, LOG, RUNS, SHELF
from apps.records import Run, recorded
from flows.artifacts import put_table
from flows.cache import remove_old
from flows.dvc_locks import DVC_LOCK
from flows.ending import by_hand_or_flow
from flows.way import ByHand, ByPrefect, Way
from pacmo_core import promotion
from stages.common.params import read_params


@dataclass(frozen=True)
class Params:
    """The ``prune`` section of ``params.yaml``."""

    cache_days: float
    runs: int
    promoted: int


def prune_here(way: Way) -> Run:
    """Prune as the only writer."""
    start_log(LOG)
    with one_writer("prune", LOCK), recorded("prune", RUNS) as run:
        params = read_params("prune", Params)
        run.facts["promoted"] = way.step(remove_models, params.promoted)
        locks = [Path(DVC_LOCK), *sorted(SHELF.glob(f"[0-9]*/{DVC_LOCK}"))]
        objects, size = way.step(remove_old, params.cache_days, locks)
        run.facts |= {"objects": objects, "bytes": size}
        run.facts["runs"] = way.step(remove_records, params.runs)
        put_table("prune", [run.facts], "What was removed")
        tell(f"pruned {objects} objects, {size / 1e6:.0f} MB", **run.facts)
    return run


def remove_models(keep: int) -> list[int]:
    """Remove promoted models but for the last and the current one."""
    now_current = promotion.current_model(SHELF)
    old = [number for number in promotion.list_models(SHELF)[:-keep] if number != now_current]
    for number in old:
        promotion.remove_model(SHELF, number)
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
    prune_here(ByPrefect())


def main() -> int:
    """Prune."""
    return by_hand_or_flow(prune, lambda: prune_here(ByHand(workers=1)))


if __name__ == "__main__":
    raise SystemExit(main())
