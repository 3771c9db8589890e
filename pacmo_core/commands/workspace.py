"""``pacmo use``, ``pacmo tidy`` and ``pacmo experiments``."""

import json
from pathlib import Path
from typing import Annotated

import typer
from ruamel.yaml import YAML

from pacmo_core.project.experiments import (
    experiment_names,
    experiment_of,
    remove_unused_outputs,
    use_experiment,
)
from pacmo_core.project.lock import writer_lock
from pacmo_core.project.objects import is_in_cache
from pacmo_core.project.promote import roll_back
from pacmo_core.project.records import record_run
from pacmo_core.project.status import last_run_failed, project_status, status_lines
from pacmo_core.project.workspace import (
    DVC_LOCK,
    EXIT_FAILED,
    LOCK,
    PARAMS,
    PROMOTED_MODELS,
    RUNS,
    errors_in_one_line,
    require_project,
)

Name = Annotated[str, typer.Argument(help="default, or a file in experiments/ without its suffix")]


def use(name: Name) -> None:
    """Write the parameters of an experiment to params.yaml.

    ``./run`` or ``dvc repro`` then reproduces it. Edited parameters are saved in history/params
    first. Outputs of folds and seeds that the experiment does not define are removed from the
    workspace; DVC's cache keeps them.
    """
    with errors_in_one_line():
        require_project()
    with errors_in_one_line(), writer_lock("use", LOCK):
        before = experiment_of(PARAMS.read_text("utf-8")) if PARAMS.exists() else ""
        saved = use_experiment(name)
        if saved:
            typer.echo(f"{PARAMS} differed from its experiment: saved as {saved}")
        _remove_unused_outputs(f"./run repro {before or 'EXPERIMENT'}")


def _remove_unused_outputs(command: str) -> None:
    """Remove outputs that the parameters do not define; say which the command brings back."""
    stored = _outputs_in_cache()
    for path in remove_unused_outputs():
        typer.echo(
            f"removed {path}, which {PARAMS} does not define: {_way_back(path, stored, command)}"
        )


def _outputs_in_cache() -> dict[Path, bool]:
    """Return the outputs of all stages of dvc.lock, and whether DVC's cache has each."""
    if not DVC_LOCK.exists():
        return {}
    stages = YAML(typ="safe").load(DVC_LOCK).get("stages", {})
    outputs = [out for stage in stages.values() for out in stage.get("outs", ())]
    return {Path(out["path"]): is_in_cache(out["md5"]) for out in outputs if "md5" in out}


def _way_back(path: Path, stored: dict[Path, bool], command: str) -> str:
    below = [has for output, has in stored.items() if output == path or path in output.parents]
    if below and all(below):
        return f"DVC's cache has it, {command} brings it back"
    return f"DVC's cache does not have all of it, {command} makes it again"


def tidy() -> None:
    """Remove outputs of folds and seeds that params.yaml does not define.

    Needed after an edit of ``runs`` in params.yaml, as scores are pooled over all files.
    """
    with errors_in_one_line():
        require_project()
    with errors_in_one_line(), writer_lock("tidy", LOCK):
        _remove_unused_outputs("./run with parameters that define it")


def experiments() -> None:
    """List the experiments."""
    with errors_in_one_line():
        require_project()
    for name in experiment_names():
        typer.echo(name)


AsJson = Annotated[bool, typer.Option("--json", help="print one JSON object")]
Check = Annotated[bool, typer.Option("--check", help="exit code 1 if the last run failed")]
Stale = Annotated[bool, typer.Option(help="list stale stages, with the reason")]
Why = Annotated[str, typer.Option("--why", help="reason, for the history")]


def status(as_json: AsJson = False, check: Check = False, stale: Stale = True) -> None:
    """Show the last runs, the current model, stale stages, inbox, quarantine and disk."""
    with errors_in_one_line():
        require_project()
        status = project_status(stale=stale)
        typer.echo(json.dumps(status, indent=2) if as_json else "\n".join(status_lines(status)))
        if check and last_run_failed(status):
            raise typer.Exit(EXIT_FAILED)


def rollback(why: Why) -> None:
    """Make the model that was current before current again, with its weights.

    The withdrawn one stays in the folder of promoted models and is not promoted again.
    """
    with (
        errors_in_one_line(),
        writer_lock("rollback", LOCK),
        record_run("rollback", RUNS) as run,
    ):
        decision = roll_back(why)
        run.reason = decision.reasons[0]
        folder = PROMOTED_MODELS / f"{decision.current_model:06d}"
        typer.echo(f"current is {folder}, model {decision.model[:12]}")
