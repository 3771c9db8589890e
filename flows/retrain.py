"""Train models again, whether or not anything has changed; then compare, and promote or hold.

python -m flows.retrain [MODEL ...]        # pacmo, pacmo_paper, regression, gru; none: all
"""

import argparse

from prefect import flow
from prefect.client.schemas.objects import State
from prefect.states import Completed
from prefect.task_runners import ThreadPoolTaskRunner

from apps.failure import CommandError
from apps.lock import one_writer
from apps.log import start_log, tell
from apps.places import LOCK, LOG, RUNS
from apps.records import Run, recorded
from flows.dvc_locks import past_a_cut_lock
from flows.ending import by_hand_or_flow
from flows.graph import stages_below
from flows.nightly import Params, check_disk, compare
from flows.reproduce import WORKERS, bring_up
from flows.way import ByHand, ByPrefect, Way
from stages.common.params import read_params


def retrain_here(way: Way, models: list[str]) -> Run:
    """Train again as the only writer, and let everything below follow."""
    start_log(LOG)
    with one_writer("retrain", LOCK), recorded("retrain", RUNS) as run:
        params = read_params("nightly", Params)
        check_disk(params.least_free_gb)
        limit_s = 3600 * params.stage_hours
        trained = bring_up(way, training_stages(models), force=True, limit_s=limit_s)
        run.facts["stages"] = trained + bring_up(way, [], force=False, limit_s=limit_s)
        run.facts["trained"] = True
        compare(way, params.gate, run)
        tell(f"retrain {run.number}: {run.outcome}", reason=run.reason, **run.facts)
    return run


def training_stages(models: list[str]) -> list[str]:
    """List the stages that train the models; none named means all.

    Raises
    ------
    CommandError
        If a model is not trained by any stage.
    """
    below = past_a_cut_lock(lambda: stages_below([]))
    stages = [name for name in below if name.startswith("train_")]
    chosen = [name for name in stages if not models or {model_of(name)} & set(models)]
    unknown = set(models) - set(map(model_of, chosen))
    if unknown:
        known = ", ".join(sorted(set(map(model_of, stages))))
        raise CommandError(f"no stage trains {', '.join(sorted(unknown))}; there are {known}")
    return chosen


def model_of(stage: str) -> str:
    """Name the model of ``train_MODEL@FOLD-SEED`` or ``train_pacmo@MODEL-FOLD-SEED``."""
    stem, _, made_of = stage.partition("@")
    first = made_of.partition("-")[0]
    return stem.removeprefix("train_") if not first or first.isdigit() else first


@flow(task_runner=ThreadPoolTaskRunner(max_workers=WORKERS), persist_result=False)
def retrain(models: list[str]) -> State[None]:
    """Train models again; none means all."""
    run = retrain_here(ByPrefect(), models)
    return Completed(name=run.outcome.capitalize(), message=run.reason or run.outcome)


def main() -> int:
    """Read the command line."""
    parser = argparse.ArgumentParser()
    parser.add_argument("models", nargs="*", metavar="MODEL")
    models: list[str] = parser.parse_args().models
    return by_hand_or_flow(
        lambda: retrain(models), lambda: retrain_here(ByHand(workers=WORKERS), models)
    )


if __name__ == "__main__":
    raise SystemExit(main())
