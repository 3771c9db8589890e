"""``pacmo use``, ``pacmo tidy`` and ``pacmo experiments``."""

import json
from typing import Annotated

import typer

from pacmo_core.project.experiments import (
    experiment_names,
    remove_unused_outputs,
    use_experiment,
)
from pacmo_core.project.lock import writer_lock
from pacmo_core.project.promote import roll_back
from pacmo_core.project.records import record_run
from pacmo_core.project.status import last_run_failed, project_status, status_lines
from pacmo_core.project.workspace import (
    EXIT_FAILED,
    LOCK,
    PARAMS,
    PROMOTED_MODELS,
    RUNS,
    errors_in_one_line,
)

Name = Annotated[str, typer.Argument(help="default, or a file in experiments/ without its suffix")]


def use(name: Name) -> None:
    """Write the parameters of an experiment to params.yaml.

    ``./run`` or ``dvc repro`` then reproduces it. Edited parameters are saved in history/params
    first. Outputs of folds and seeds that the experiment does not define are removed from the
    workspace; DVC's cache keeps them.
    """
    with errors_in_one_line(), writer_lock("use", LOCK):
        saved = use_experiment(name)
        if saved:
            typer.echo(f"the edited {PARAMS} is saved as {saved}")
        for path in remove_unused_outputs():
            typer.echo(f"removed {path}, which {PARAMS} does not define")


def tidy() -> None:
    """Remove outputs of folds and seeds that params.yaml does not define.

    Needed after an edit of ``runs`` in params.yaml, as scores are pooled over all files.
    """
    with errors_in_one_line(), writer_lock("tidy", LOCK):
        for path in remove_unused_outputs():
            typer.echo(f"removed {path}, which {PARAMS} does not define")


def experiments() -> None:
    """List the experiments."""
    for name in experiment_names():
        typer.echo(name)


AsJson = Annotated[bool, typer.Option("--json", help="print one JSON object")]
Check = Annotated[bool, typer.Option("--check", help="exit code 1 if the last run failed")]
Stale = Annotated[bool, typer.Option(help="list stale stages, with the reason")]
Why = Annotated[str, typer.Option("--why", help="reason, for the history")]


def status(as_json: AsJson = False, check: Check = False, stale: Stale = True) -> None:
    """Show the last runs, the current model, stale stages, inbox, quarantine and disk."""
    with errors_in_one_line():
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
