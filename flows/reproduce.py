"""Reproduce targets: each stale DVC stage is a Prefect task.

Which stage depends on which is written in ``dvc.yaml`` alone. DVC decides whether a stage runs,
Prefect when, and beside which others. Stages are not retried: their result is deterministic, and
so is their failure.
"""

import json
import time
from collections.abc import Callable
from itertools import count
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from prefect import flow, task
from prefect.artifacts import (
    create_link_artifact,
    create_markdown_artifact,
    create_table_artifact,
)
from prefect.cache_policies import NO_CACHE
from prefect.context import FlowRunContext
from prefect.futures import PrefectFuture
from prefect.task_runners import ThreadPoolTaskRunner

from flows.dvc_commands import RAN, RESTORED, UP_TO_DATE, reproduce_stage
from pacmo_core.commands.report import write_report_with_history
from pacmo_core.figures.tables import markdown_table
from pacmo_core.metrics.catalogue import MAIN_COLUMNS
from pacmo_core.project.experiments import remove_unused_outputs, use_experiment
from pacmo_core.project.lock import remove_dead_dvc_locks, remove_partial_files, writer_lock
from pacmo_core.project.objects import remove_corrupt_objects
from pacmo_core.project.records import record_run
from pacmo_core.project.stages import is_target, readable_dvc_lock, upstream_and_stale
from pacmo_core.project.workspace import (
    DETAILS,
    LOCK,
    PARAMS,
    REPORT,
    RUNS,
    CommandError,
    configure_logging,
    log_event,
)
from pacmo_core.store.files import file_hash

N_WORKERS = 2
STAGE_LIMIT_S = 12 * 3600.0
INGESTED = Path("reports/ingest.json")

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


@flow(task_runner=ThreadPoolTaskRunner(max_workers=N_WORKERS), persist_result=False)
def reproduce(
    targets: list[str], force: bool = False, experiment: str = "", params_hash: str = ""
) -> list[str]:
    """Reproduce ``targets`` (none: everything), two stages at a time where the graph allows.

    Parameters
    ----------
    targets : stages by address or name
    force : run the targets themselves even if nothing that they depend on has changed
    experiment : whose parameters to use; empty for those in ``params.yaml``
    params_hash : SHA-256 of the ``params.yaml`` that is to be run; empty for any

    Returns
    -------
    the stages that were stale, in running order

    Raises
    ------
    CommandError
        If ``params.yaml`` is another one.
    """
    configure_logging()
    with writer_lock("reproduce", LOCK), record_run("reproduce", RUNS) as run:
        if experiment:
            switch_experiment(experiment)
        if params_hash:
            check_params(params_hash)
        stages = run_stale_stages(targets, force=force, limit_s=STAGE_LIMIT_S)
        run.facts["stages"] = stages
        if stages and not targets and REPORT.exists():
            write_report_with_history()
    publish_metrics(DETAILS)
    return stages


def check_params(expected_hash: str) -> None:
    """Check that ``params.yaml`` is still the one that a run began with.

    Every stage reads it: of a run whose parameters changed, nobody could say whose result it is.

    Raises
    ------
    CommandError
        If it is another one.
    """
    if file_hash(PARAMS) != expected_hash:
        raise CommandError(f"{PARAMS} was changed after this run had begun; run ./run again")


def switch_experiment(experiment: str) -> None:
    """Use an experiment; log where edited parameters were saved, and which outputs were removed."""
    saved = use_experiment(experiment)
    if saved:
        log_event(f"{PARAMS} differed from its experiment: saved as {saved}", path=saved)
    for path in remove_unused_outputs():
        log_event(f"removed {path}, which {PARAMS} does not define", path=path)


def run_stale_stages(targets: list[str], *, force: bool, limit_s: float) -> list[str]:
    """Run the stale stages among ``targets`` and all they depend on; the caller holds the lock.

    Parameters
    ----------
    targets : stages by address or name; none means every stage
    force : run the targets themselves even if nothing that they depend on has changed
    limit_s : seconds a stage

    Returns
    -------
    the stages that ran or were restored, in running order
    """
    params_hash = file_hash(PARAMS)
    remove_dead_dvc_locks()
    remove_corrupt_objects(skip_verified=True)
    for path in remove_partial_files():
        log_event(f"removed {path}, which a killed run had not finished writing")
    upstream, stale = readable_dvc_lock(lambda: upstream_and_stale(targets))
    forced = {name for name in upstream if force and (not targets or is_target(name, targets))}
    selected = stale | forced
    # What depends on a forced stage is checked again after it.
    for name, names in upstream.items():
        if selected & set(names):
            selected.add(name)
    order = {name: names for name, names in upstream.items() if name in selected}
    if order:
        log_event(f"{len(order)} of {len(upstream)} stages are stale", n_stages=len(order))
    _run_tasks(order, forced, limit_s, params_hash)
    check_params(params_hash)
    # What this run has made is hashed now, not by the next one that has nothing to do.
    remove_corrupt_objects(skip_verified=True)
    return list(order)


def _run_tasks(
    order: dict[str, list[str]], forced: set[str], limit_s: float, params_hash: str
) -> None:
    numbers = count(1)

    def run(stage: str) -> None:
        check_params(params_hash)
        log_event(f"start {stage}", stage=stage, state="start")
        start = time.monotonic()
        outcome = reproduce_stage(stage, force=stage in forced, limit_s=limit_s)
        seconds = round(time.monotonic() - start, 1)
        position = f"{next(numbers)} of {len(order)}"
        text = {
            RAN: f"done {stage} in {seconds:.0f} s, {position}",
            RESTORED: f"restored {stage} from the cache in {seconds:.0f} s, {position}",
        }.get(outcome, f"up to date {stage}, {position}")
        log_event(text, stage=stage, state="end", outcome=outcome, seconds=seconds)
        if stage == "ingest" and outcome != UP_TO_DATE:
            say_what_was_quarantined()

    futures: dict[str, PrefectFuture[None]] = {}
    for stage, upstream in order.items():
        stage_task = task(run, name=stage, cache_policy=NO_CACHE, persist_result=False)
        waits = [futures[name] for name in upstream if name in futures]
        futures[stage] = stage_task.submit(stage, wait_for=waits)
    for future in futures.values():
        future.result()  # wait() alone would leave the flow Completed though every task failed


def say_what_was_quarantined() -> None:
    """Log how many captures the stage ``ingest`` could not use, if there are some."""
    facts = json.loads(INGESTED.read_text(encoding="utf-8"))
    if facts["quarantined"]:
        log_event(
            f"{facts['quarantined']} of {facts['sequences_read']} captures cannot be used: "
            "pacmo quarantine lists why"
        )


def run_step(
    function: Callable[Arguments, Result], *args: Arguments.args, **kwargs: Arguments.kwargs
) -> Result:
    """Call a function as a Prefect task, so that it has a state and a time on Prefect's page."""
    step = task(function, name=function.__name__, cache_policy=NO_CACHE, persist_result=False)
    result: Result = step(*args, **kwargs)
    return result


def publish_metrics(path: Path) -> None:
    """Put the table of ``reports/details.json`` and a link to the report on Prefect's page."""
    if FlowRunContext.get() is None or not path.exists():
        return
    facts = json.loads(path.read_text(encoding="utf-8"))
    table = markdown_table(_main_columns(facts["pacmo"]["rows"]))
    text = f"# {facts['experiment']}\n\n## Reactions\n\n{table}"
    create_markdown_artifact(text, key="metrics", description="Metrics of every row of the table")
    publish_link(REPORT, "report", "What the run found, clips that play, and every table")


def publish_table(key: str, rows: list[dict[str, Any]], description: str) -> None:
    """Put a table on Prefect's page."""
    if FlowRunContext.get() is not None:
        create_table_artifact(rows, key=key, description=description)


def publish_link(page: Path, key: str, description: str) -> None:
    """Put a link to one of the project's pages on Prefect's page."""
    if FlowRunContext.get() is not None and page.exists():
        create_link_artifact(
            page.resolve().as_uri(), key=key, link_text=page.as_posix(), description=description
        )


def _main_columns(rows: dict[str, Any]) -> dict[str, Any]:
    return {row: {c: cells[c] for c in MAIN_COLUMNS if c in cells} for row, cells in rows.items()}
