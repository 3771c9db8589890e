"""One night: take captures in, bring everything up to date, compare, promote or hold.

python -m flows.nightly [--experiment NAME]

inbox -> validate -> ingest ... report -> gate -> promoted/current
"""

import argparse
import shutil
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

from prefect import flow, runtime
from prefect.client.schemas.objects import State
from prefect.server.schemas.schedules import CronSchedule
from prefect.states import Completed
from prefect.task_runners import ThreadPoolTaskRunner

from flows.artifacts import link_to, publish, put_table
from flows.ending import by_hand_or_flow
from flows.inbox import take_captures
from flows.prune import remove_corrupt_objects
from flows.remote import push
from flows.reproduce import WORKERS, bring_up
from flows.way import ByHand, ByPrefect, Way
from pacmo_core.commands.report import write_report_with_history
from pacmo_core.project.experiments import use_experiment
from pacmo_core.project.lock import writer_lock
from pacmo_core.project.promote import decide_promotion
from pacmo_core.project.records import DONE, FAILED, HELD, SKIPPED, RunRecord, read_runs, record_run
from pacmo_core.project.stages import readable_dvc_lock, upstream_stages
from pacmo_core.project.workspace import (
    DETAILS,
    HISTORY_PAGE,
    LOCK,
    LOG,
    REPORT,
    REPORT_WITH_HISTORY,
    RUNS,
    CommandError,
    configure_logging,
    log_event,
)
from pacmo_core.promotion import REJECTED, Gate
from stages.common.params import read_params

_GB = 1e9
_STAGES_BEFORE_TRAINING = ["split"]  # as far as captures go without training anything


@dataclass(frozen=True)
class Params:
    """The ``nightly`` section of ``params.yaml``."""

    gate: Gate
    least_new: int  # captures since the last training from which training is due
    least_free_gb: float  # of disk, below which no night begins
    stage_hours: float  # the longest that a stage may take
    settle_s: float  # seconds a capture must not change to be taken


def run_nightly(way: Way, experiment: str = "", scheduled: datetime | None = None) -> RunRecord:
    """Run one night as the only writer.

    Parameters
    ----------
    way : how its steps are run
    experiment : whose captures and models; empty for the one that ``params.yaml`` holds
    scheduled : the time it was to start; a night that began since then has done its work
    """
    configure_logging(LOG)
    with writer_lock("nightly", LOCK), record_run("nightly", RUNS) as run:
        if is_covered(scheduled, read_runs(RUNS), datetime.now(UTC)):
            run.outcome, run.reason = SKIPPED, f"a night began after {scheduled}: caught up once"
        else:
            _run_nightly(way, experiment, run)
        log_event(f"night {run.number}: {run.outcome}", reason=run.reason, **run.facts)
    return run


def _run_nightly(way: Way, experiment: str, run: RunRecord) -> None:
    if experiment:
        use_experiment(experiment)
    params = read_params("nightly", Params)
    check_disk(params.least_free_gb)
    limit_s = 3600 * params.stage_hours
    run.facts["spoilt_objects"] = way.step(remove_corrupt_objects)
    intake = way.step(take_captures, params.settle_s)
    run.facts |= vars(intake)
    due = is_training_due(read_runs(RUNS), len(intake.taken), params.least_new)
    targets = [] if due else _STAGES_BEFORE_TRAINING
    run.facts["stages"] = bring_up(way, targets, force=False, limit_s=limit_s)
    run.facts["trained"] = due
    if due:
        compare_and_promote(way, params.gate, run)
    else:
        run.reason = f"training waits for {params.least_new} new captures"
    run.facts["pushed"] = way.step(push, limit_s)


def compare_and_promote(way: Way, gate: Gate, run: RunRecord) -> None:
    """Decide about what stands in the workspace, and write that down where people look."""
    decision = way.step(decide_promotion, gate)
    run.outcome = HELD if decision.verdict == REJECTED else DONE
    run.reason = "; ".join((decision.verdict, *decision.reasons))
    run.facts |= {"decision": decision.number, "verdict": decision.verdict}
    publish(DETAILS)
    rows = [{"metric": name, **cell} for name, cell in decision.metrics.items()]
    put_table("decision", rows, f"{decision.verdict}: {'; '.join(decision.reasons)}")
    if REPORT.exists():
        write_report_with_history()
    link_to(HISTORY_PAGE, "history")
    link_to(REPORT_WITH_HISTORY, "report-and-history")


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


def is_training_due(runs: list[RunRecord], taken: int, least_new: int) -> bool:
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
    run = run_nightly(ByPrefect(), experiment, runtime.flow_run.scheduled_start_time)
    return Completed(name=run.outcome.capitalize(), message=run.reason or run.outcome)


def main() -> int:
    """Read the command line."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--experiment", default="")
    given = vars(parser.parse_args())
    return by_hand_or_flow(
        lambda: nightly(**given), lambda: run_nightly(ByHand(workers=WORKERS), **given)
    )


if __name__ == "__main__":
    raise SystemExit(main())


# FROM """Nights that were missed are caught up once, by the next that runs."""
_STARTED = (DONE, HELD, FAILED)
_MAX_AGE = timedelta(days=40)


def is_covered(scheduled: datetime | None, runs: list[RunRecord], now: datetime) -> bool:
    """Tell whether a night that began since then has done the work of a scheduled one.

    After a week's absence a server starts seven late nights. The first takes in all that lies
    there; the six others come here after it.

    Parameters
    ----------
    scheduled : when the night was to start; None for one that a person starts
    runs : what has run, this one's record among them
    now : the time; a night that began later than this was begun by a clock that has jumped back
    """
    began = [datetime.fromisoformat(run.started) for run in _nightly_runs(runs)]
    return scheduled is not None and any(scheduled <= start <= now for start in began)


async def is_missed(cron: str, timezone: str, runs: list[RunRecord], now: datetime) -> bool:
    """Tell whether no night has begun since the schedule last asked for one.

    Where there never was a night, none is missed: the first comes at its hour.
    """
    nights = _nightly_runs(runs)
    if not nights:
        return False
    schedule = CronSchedule(cron=cron, timezone=timezone)
    asked = await schedule.get_dates(n=1000, start=now - _MAX_AGE, end=now)
    return bool(asked) and not is_covered(asked[-1], runs, now)


def _nightly_runs(runs: list[RunRecord]) -> list[RunRecord]:
    return [run for run in runs if run.job == "nightly" and run.outcome in _STARTED]


# FROM """Train models again, whether or not anything has changed; then compare, and promote or hold.
# FROM
# FROM python -m flows.nightly [MODEL ...]        # pacmo, pacmo_plain, regression, gru; none: all
# FROM """
def run_retrain(way: Way, models: list[str]) -> RunRecord:
    """Train again as the only writer, and let everything below follow."""
    configure_logging(LOG)
    with writer_lock("retrain", LOCK), record_run("retrain", RUNS) as run:
        params = read_params("nightly", Params)
        check_disk(params.least_free_gb)
        limit_s = 3600 * params.stage_hours
        trained = bring_up(way, training_stages(models), force=True, limit_s=limit_s)
        run.facts["stages"] = trained + bring_up(way, [], force=False, limit_s=limit_s)
        run.facts["trained"] = True
        compare_and_promote(way, params.gate, run)
        log_event(f"retrain {run.number}: {run.outcome}", reason=run.reason, **run.facts)
    return run


def training_stages(models: list[str]) -> list[str]:
    """List the stages that train the models; none named means all.

    Raises
    ------
    CommandError
        If a model is not trained by any stage.
    """
    below = readable_dvc_lock(lambda: upstream_stages([]))
    stages = [name for name in below if name.startswith("train_")]
    chosen = [name for name in stages if not models or {trained_model(name)} & set(models)]
    unknown = set(models) - set(map(trained_model, chosen))
    if unknown:
        known = ", ".join(sorted(set(map(trained_model, stages))))
        raise CommandError(f"no stage trains {', '.join(sorted(unknown))}; there are {known}")
    return chosen


def trained_model(stage: str) -> str:
    """Name the model of ``train_MODEL@FOLD-SEED`` or ``train_pacmo@MODEL-FOLD-SEED``."""
    stem, _, made_of = stage.partition("@")
    first = made_of.partition("-")[0]
    return stem.removeprefix("train_") if not first or first.isdigit() else first


@flow(task_runner=ThreadPoolTaskRunner(max_workers=WORKERS), persist_result=False)
def retrain(models: list[str]) -> State[None]:
    """Train models again; none means all."""
    run = run_retrain(ByPrefect(), models)
    return Completed(name=run.outcome.capitalize(), message=run.reason or run.outcome)


def main_retrain() -> int:
    """Read the command line."""
    parser = argparse.ArgumentParser()
    parser.add_argument("models", nargs="*", metavar="MODEL")
    models: list[str] = parser.parse_args().models
    return by_hand_or_flow(
        lambda: retrain(models), lambda: run_retrain(ByHand(workers=WORKERS), models)
    )


if __name__ == "__main__":
    raise SystemExit(main_retrain())
