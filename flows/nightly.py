"""Nightly and retraining: take captures in, reproduce, compare with the current model, promote.

inbox -> validation -> ingest ... report -> gate -> promoted/current
"""

import shutil
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

from prefect import flow, runtime
from prefect.client.schemas.objects import State
from prefect.server.schemas.schedules import CronSchedule
from prefect.states import Completed
from prefect.task_runners import ThreadPoolTaskRunner

from flows.dvc_commands import push
from flows.inbox import take_captures
from flows.reproduce import (
    N_WORKERS,
    publish_link,
    publish_metrics,
    publish_table,
    run_stale_stages,
    run_step,
    switch_experiment,
)
from pacmo_core.commands.report import write_report_with_history
from pacmo_core.project.lock import writer_lock
from pacmo_core.project.objects import remove_corrupt_objects
from pacmo_core.project.promote import decide_promotion
from pacmo_core.project.records import (
    DONE,
    FAILED,
    REJECTED,
    SKIPPED,
    RunRecord,
    read_runs,
    record_run,
)
from pacmo_core.project.stages import readable_dvc_lock, upstream_stages
from pacmo_core.project.workspace import (
    DETAILS,
    HISTORY_PAGE,
    LOCK,
    REPORT,
    REPORT_WITH_HISTORY,
    RUNS,
    CommandError,
    configure_logging,
    log_event,
)
from pacmo_core.promotion import REJECTED as MODEL_REJECTED
from pacmo_core.promotion import Gate
from stages.common.params import read_params

_GB = 1e9
_STAGES_BEFORE_TRAINING = ["split"]
_STARTED = (DONE, REJECTED, FAILED)
_MAX_AGE = timedelta(days=40)


@dataclass(frozen=True)
class Params:
    """The ``nightly`` section of ``params.yaml``.

    Parameters
    ----------
    gate : what a model must satisfy to be promoted
    min_new_captures : new captures since the last training from which the models are trained
    min_free_gb : of disk, below which no nightly starts
    max_stage_hours : time limit of a stage
    settle_s : seconds for which a capture must not change to be taken
    """

    gate: Gate
    min_new_captures: int
    min_free_gb: float
    max_stage_hours: float
    settle_s: float


@flow(task_runner=ThreadPoolTaskRunner(max_workers=N_WORKERS), persist_result=False)
def nightly(experiment: str = "") -> State[None]:
    """Take new captures in, reproduce, compare, and promote the model or hold it back."""
    run = run_nightly(experiment, runtime.flow_run.scheduled_start_time)
    return Completed(name=run.outcome.capitalize(), message=run.reason or run.outcome)


@flow(task_runner=ThreadPoolTaskRunner(max_workers=N_WORKERS), persist_result=False)
def retrain(models: list[str]) -> State[None]:
    """Train models again, whether or not anything has changed (none: all); then compare."""
    run = run_retrain(models)
    return Completed(name=run.outcome.capitalize(), message=run.reason or run.outcome)


def run_nightly(experiment: str = "", scheduled: datetime | None = None) -> RunRecord:
    """Run one nightly, within a flow.

    Parameters
    ----------
    experiment : whose parameters to use; empty for those in ``params.yaml``
    scheduled : when it was to start; it is skipped if a nightly has started since
    """
    configure_logging()
    with writer_lock("nightly", LOCK), record_run("nightly", RUNS) as run:
        if is_covered(scheduled, read_runs(RUNS), datetime.now(UTC)):
            run.outcome = SKIPPED
            run.reason = f"a nightly has started since {scheduled}"
        else:
            _run_steps(experiment, run)
        log_event(f"nightly {run.number}: {run.outcome}", reason=run.reason, **run.facts)
    return run


def _run_steps(experiment: str, run: RunRecord) -> None:
    if experiment:
        switch_experiment(experiment)
    params = read_params("nightly", Params)
    check_disk(params.min_free_gb)
    limit_s = 3600 * params.max_stage_hours
    run.facts["corrupt_objects"] = run_step(remove_corrupt_objects)
    intake = run_step(take_captures, params.settle_s)
    run.facts |= vars(intake)
    due = is_training_due(read_runs(RUNS), len(intake.accepted), params.min_new_captures)
    targets = [] if due else _STAGES_BEFORE_TRAINING
    run.facts["stages"] = run_stale_stages(targets, force=False, limit_s=limit_s)
    run.facts["trained"] = due
    if due:
        compare_and_promote(params.gate, run)
    else:
        run.reason = f"fewer than {params.min_new_captures} new captures: no training"
    run.facts["pushed"] = run_step(push, limit_s)


def run_retrain(models: list[str]) -> RunRecord:
    """Train models again and run all stages that depend on them, within a flow."""
    configure_logging()
    with writer_lock("retrain", LOCK), record_run("retrain", RUNS) as run:
        params = read_params("nightly", Params)
        check_disk(params.min_free_gb)
        limit_s = 3600 * params.max_stage_hours
        trained = run_stale_stages(training_stages(models), force=True, limit_s=limit_s)
        run.facts["stages"] = trained + run_stale_stages([], force=False, limit_s=limit_s)
        run.facts["trained"] = True
        compare_and_promote(params.gate, run)
        log_event(f"retrain {run.number}: {run.outcome}", reason=run.reason, **run.facts)
    return run


def compare_and_promote(gate: Gate, run: RunRecord) -> None:
    """Compare the model in the workspace with the current one, promote it or not, and report."""
    decision = run_step(decide_promotion, gate)
    run.outcome = REJECTED if decision.verdict == MODEL_REJECTED else DONE
    run.reason = "; ".join((decision.verdict, *decision.reasons))
    run.facts |= {"decision": decision.number, "verdict": decision.verdict}
    publish_metrics(DETAILS)
    rows = [{"metric": name, **cell} for name, cell in decision.metrics.items()]
    publish_table("decision", rows, f"{decision.verdict}: {'; '.join(decision.reasons)}")
    if REPORT.exists():
        write_report_with_history()
    publish_link(HISTORY_PAGE, "history", "Every decision, and the metrics over time")
    publish_link(
        REPORT_WITH_HISTORY, "report-and-history", "The report with earlier runs and decisions"
    )


def check_disk(min_free_gb: float) -> None:
    """Check the free space of the disk.

    Raises
    ------
    CommandError
        If it is below the minimum.
    """
    free = shutil.disk_usage(Path.cwd()).free / _GB
    if free < min_free_gb:
        raise CommandError(
            f"{free:.1f} GB are free; nightly.min_free_gb is {min_free_gb:g}: ./run prune"
        )


def is_training_due(runs: list[RunRecord], n_accepted: int, min_new_captures: int) -> bool:
    """Return whether to train: unless there are new captures, but fewer than the minimum.

    Without new captures it is due: other changes were made by a person.

    Parameters
    ----------
    runs : records of earlier runs
    n_accepted : captures accepted by this run
    min_new_captures : since the last training
    """
    n_new = n_accepted
    for run in reversed(runs):
        if run.facts.get("trained"):
            break
        n_new += len(run.facts.get("accepted", ()))
    return not 0 < n_new < min_new_captures


def is_covered(scheduled: datetime | None, runs: list[RunRecord], now: datetime) -> bool:
    """Return whether a nightly that started since then has done the work of a scheduled one.

    After a week without a server, it starts seven late nightlies. The first takes in all captures;
    the other six are covered by it.

    Parameters
    ----------
    scheduled : when the nightly was to start; None if it was not scheduled
    runs : records of runs, the present one's included
    now : present time; a nightly that started later did so before the clock was set back
    """
    starts = [datetime.fromisoformat(run.started) for run in _nightly_runs(runs)]
    return scheduled is not None and any(scheduled <= start <= now for start in starts)


async def is_missed(cron: str, timezone: str, runs: list[RunRecord], now: datetime) -> bool:
    """Return whether no nightly has started since the last time of a schedule.

    If there never was one, none is missed.
    """
    if not _nightly_runs(runs):
        return False
    schedule = CronSchedule(cron=cron, timezone=timezone)
    times = await schedule.get_dates(n=1000, start=now - _MAX_AGE, end=now)
    return bool(times) and not is_covered(times[-1], runs, now)


def training_stages(models: list[str]) -> list[str]:
    """List the stages that train the models; none named means all.

    Raises
    ------
    CommandError
        If no stage trains one of the models.
    """
    upstream = readable_dvc_lock(lambda: upstream_stages([]))
    stages = [name for name in upstream if name.startswith("train_")]
    selected = [name for name in stages if not models or trained_model(name) in models]
    unknown = set(models) - set(map(trained_model, selected))
    if unknown:
        known = ", ".join(sorted(set(map(trained_model, stages))))
        raise CommandError(f"no stage trains {', '.join(sorted(unknown))}; there are {known}")
    return selected


def trained_model(stage: str) -> str:
    """Return the model of a training stage, by the keys of its matrix in ``dvc.yaml``."""
    name, _, keys = stage.partition("@")
    if name in (
        "train_features",
        "train_reaction",
        "train_pacmo_variant",
    ):  # MODEL-FOLD, MODEL-FOLD-SEED
        return keys.partition("-")[0]
    if name == "train_skeleton_prior":  # DATASET-SPLIT-MODEL-SEED
        return keys.split("-")[-2]
    return name.removeprefix("train_")


def _nightly_runs(runs: list[RunRecord]) -> list[RunRecord]:
    return [run for run in runs if run.job == "nightly" and run.outcome in _STARTED]
