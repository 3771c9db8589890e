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

from apps.experiments import use
from apps.lock import one_writer
from apps.log import start_log, tell
from apps.places import LOCK, LOG, METRICS, RUNS
from apps.records import recorded
from flows.artifacts import publish
from flows.dvc_locks import forget_the_dead, past_a_cut_lock
from flows.ending import by_hand_or_flow
from flows.graph import survey
from flows.litter import remove_litter
from flows.run_dvc import run_dvc
from flows.way import ByHand, ByPrefect, Way

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
    forget_the_dead()
    for path in remove_litter():
        tell("removed what a killed run had half written", path=path)
    below, stale = past_a_cut_lock(lambda: survey(targets))
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
        tell(f"up to date: {stage}", stage=stage)

    if order:
        way.stages(reproduce_stage, order)
    return list(order)


def reproduce_here(
    way: Way, targets: list[str], *, force: bool = False, experiment: str = ""
) -> list[str]:
    """Reproduce as the only writer, with a record of the run."""
    start_log(LOG)
    with one_writer("reproduce", LOCK), recorded("reproduce", RUNS) as run:
        if experiment:
            use(experiment, discard=False)
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
    publish(METRICS)
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
