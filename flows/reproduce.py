"""Bring targets up to date, each stale DVC stage as one task.

    python -m flows.reproduce [--experiment NAME] [--force] [STAGE ...]

Which stage rests on which is written once, in ``dvc.yaml``; this flow only reads it. DVC decides
whether a stage runs, Prefect when and beside what. No retries: a stage that fails once fails
twice. With a Prefect server (``PREFECT_API_URL``) the run and the metrics stand on its page;
without one the same function runs here.
"""

import argparse

from prefect import flow
from prefect.task_runners import ThreadPoolTaskRunner

from flows.artifacts import publish
from flows.ending import by_hand_or_flow
from flows.run_dvc import run_dvc
from flows.way import ByHand, ByPrefect, Way
from pacmo_core.project.experiments import use_experiment
from pacmo_core.project.lock import remove_dead_dvc_locks, remove_partial_files, writer_lock
from pacmo_core.project.records import record_run
from pacmo_core.project.stages import readable_dvc_lock, upstream_and_stale
from pacmo_core.project.workspace import DETAILS, LOCK, LOG, RUNS, configure_logging, log_event

WORKERS = 2
STAGE_LIMIT_S = 12 * 3600.0


def bring_up(way: Way, targets: list[str], *, force: bool, limit_s: float) -> list[str]:
    """Run the stale stages among ``targets`` and all they rest on; the caller holds the lock.

    Parameters
    ----------
    targets : stages by address; none means every stage
    force : run the targets themselves even if nothing they read has changed
    limit_s : seconds a stage

    Returns
    -------
    the stages that ran or were restored, in running order
    """
    remove_dead_dvc_locks()
    for path in remove_partial_files():
        log_event("removed what a killed run had half written", path=path)
    below, stale = readable_dvc_lock(lambda: upstream_and_stale(targets))
    forced = {name for name in below if force and _is_target(name, targets)}
    wanted = stale | forced
    # What rests on a forced stage is looked at again after it.
    for name, upstream in below.items():
        if wanted & set(upstream):
            wanted.add(name)
    order = {name: upstream for name, upstream in below.items() if name in wanted}

    def reproduce_stage(stage: str) -> None:
        options = ["--force"] if stage in forced else []
        run_dvc(stage, ["repro", "--single-item", *options, stage], limit_s)
        log_event(f"up to date: {stage}", stage=stage)

    if order:
        way.stages(reproduce_stage, order)
    return list(order)


def reproduce_here(
    way: Way, targets: list[str], *, force: bool = False, experiment: str = ""
) -> list[str]:
    """Reproduce as the only writer, with a record of the run."""
    configure_logging(LOG)
    with writer_lock("reproduce", LOCK), record_run("reproduce", RUNS) as run:
        if experiment:
            use_experiment(experiment)
        run.facts["stages"] = bring_up(way, targets, force=force, limit_s=STAGE_LIMIT_S)
        stages: list[str] = run.facts["stages"]
        return stages


@flow(task_runner=ThreadPoolTaskRunner(max_workers=WORKERS), persist_result=False)
def reproduce(targets: list[str], force: bool = False, experiment: str = "") -> list[str]:
    """Reproduce ``targets`` (none: everything), side by side where the graph allows.

    Returns
    -------
    the stages that were stale, in running order
    """
    stages = reproduce_here(ByPrefect(), targets, force=force, experiment=experiment)
    publish(DETAILS)
    return stages


def _is_target(name: str, targets: list[str]) -> bool:
    return not targets or name in targets or name.partition("@")[0] in targets


def main() -> int:
    """Read the command line."""
    parser = argparse.ArgumentParser()
    parser.add_argument("targets", nargs="*", metavar="STAGE")
    parser.add_argument("--experiment", default="")
    parser.add_argument("--force", action="store_true")
    given = vars(parser.parse_args())
    return by_hand_or_flow(
        lambda: reproduce(**given), lambda: reproduce_here(ByHand(workers=WORKERS), **given)
    )


if __name__ == "__main__":
    raise SystemExit(main())
