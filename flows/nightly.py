"""One night: take captures in, bring everything up to date, compare, promote or hold.

python -m flows.nightly [--experiment NAME]

inbox -> validate -> ingest ... report -> gate -> promoted/current
"""

import argparse
import shutil
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from prefect import flow, runtime
from prefect.client.schemas.objects import State
from prefect.states import Completed
from prefect.task_runners import ThreadPoolTaskRunner

from apps.experiments import use
from apps.failure import CommandError
from apps.lock import one_writer
from apps.log import start_log, tell
from apps.places import LOCK, LOG, METRICS, PAGE, REPORT, RUNS, WHOLE
from apps.promote import decide
from apps.records import DONE, HELD, SKIPPED, Run, read_runs, recorded
from apps.whole_page import write_whole
from flows.artifacts import link_to, publish, put_table
from flows.cache import remove_spoilt
from flows.ending import by_hand_or_flow
from flows.inbox import take_in
from flows.missed import is_covered
from flows.remote import push
from flows.reproduce import WORKERS, bring_up
from flows.way import ByHand, ByPrefect, Way
from pacmo_core.promotion import REJECTED, Gate
from stages.common.params import read_params

_GB = 1e9
_FIRST_STAGES = ["split"]  # as far as captures go without training anything


@dataclass(frozen=True)
class Params:
    """The ``nightly`` section of ``params.yaml``."""

    gate: Gate
    least_new: int  # captures since the last training from which training is due
    least_free_gb: float  # of disk, below which no night begins
    stage_hours: float  # the longest that a stage may take
    settle_s: float  # seconds a capture must not change to be taken


def night(way: Way, experiment: str = "", scheduled: datetime | None = None) -> Run:
    """Run one night as the only writer.

    Parameters
    ----------
    way : how its steps are run
    experiment : whose captures and models; empty for the one that ``params.yaml`` holds
    scheduled : the time it was to start; a night that began since then has done its work
    """
    start_log(LOG)
    with one_writer("nightly", LOCK), recorded("nightly", RUNS) as run:
        if is_covered(scheduled, read_runs(RUNS), datetime.now(UTC)):
            run.outcome, run.reason = SKIPPED, f"a night began after {scheduled}: caught up once"
        else:
            _work(way, experiment, run)
        tell(f"night {run.number}: {run.outcome}", reason=run.reason, **run.facts)
    return run


def _work(way: Way, experiment: str, run: Run) -> None:
    if experiment:
        use(experiment, discard=False)
    params = read_params("nightly", Params)
    check_disk(params.least_free_gb)
    limit_s = 3600 * params.stage_hours
    run.facts["spoilt_objects"] = way.step(remove_spoilt)
    intake = way.step(take_in, params.settle_s)
    run.facts |= vars(intake)
    due = is_due(read_runs(RUNS), len(intake.taken), params.least_new)
    targets = [] if due else _FIRST_STAGES
    run.facts["stages"] = bring_up(way, targets, force=False, limit_s=limit_s)
    run.facts["trained"] = due
    if due:
        compare(way, params.gate, run)
    else:
        run.reason = f"training waits for {params.least_new} new captures"
    run.facts["pushed"] = way.step(push, limit_s)


def compare(way: Way, gate: Gate, run: Run) -> None:
    """Decide about what stands in the workspace, and write that down where people look."""
    decision = way.step(decide, gate)
    run.outcome = HELD if decision.verdict == REJECTED else DONE
    run.reason = "; ".join((decision.verdict, *decision.reasons))
    run.facts |= {"decision": decision.number, "verdict": decision.verdict}
    publish(METRICS)
    rows = [{"metric": name, **cell} for name, cell in decision.metrics.items()]
    put_table("decision", rows, f"{decision.verdict}: {'; '.join(decision.reasons)}")
    if REPORT.exists():
        write_whole()
    link_to(PAGE, "history")
    link_to(WHOLE, "report-and-history")


def check_disk(least_free_gb: float) -> None:
    """Refuse to begin what would fill the disk.

    Raises
    ------
    CommandError
        If less is free.
    """
    free = shutil.disk_usage(Path.cwd()).free / _GB
    if free < least_free_gb:
        raise CommandError(
            f"{free:.1f} GB are free and nightly.least_free_gb wants {least_free_gb:g}: "
            "python -m flows.prune"
        )


def is_due(runs: list[Run], taken: int, least_new: int) -> bool:
    """Tell whether training is due: not while a few new captures wait for more.

    Without new captures it is always due: what else is stale was edited by a person.
    """
    waiting = taken
    for run in reversed(runs):
        if run.facts.get("trained"):
            break
        waiting += len(run.facts.get("taken", ()))
    return not 0 < waiting < least_new


@flow(task_runner=ThreadPoolTaskRunner(max_workers=WORKERS), persist_result=False)
def nightly(experiment: str = "") -> State[None]:
    """Take new captures in, reproduce, compare, and promote or hold."""
    run = night(ByPrefect(), experiment, runtime.flow_run.scheduled_start_time)
    return Completed(name=run.outcome.capitalize(), message=run.reason or run.outcome)


def main() -> int:
    """Read the command line."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--experiment", default="")
    given = vars(parser.parse_args())
    return by_hand_or_flow(
        lambda: nightly(**given), lambda: night(ByHand(workers=WORKERS), **given)
    )


if __name__ == "__main__":
    raise SystemExit(main())
