"""``pacmo use``, ``pacmo tidy`` and ``pacmo experiments``."""

from typing import Annotated

import typer

from pacmo_core.project.experiments import (
    experiment_names,
    remove_unused_outputs,
    use_experiment,
)
from pacmo_core.project.workspace import PARAMS, errors_in_one_line

Name = Annotated[str, typer.Argument(help="default, or a file in experiments/ without its suffix")]


def use(name: Name) -> None:
    """Write the parameters of an experiment to params.yaml.

    ``./run`` or ``dvc repro`` then reproduces it. Edited parameters are saved in history/params
    first. Outputs of folds and seeds that the experiment does not define are removed from the
    workspace; DVC's cache keeps them.
    """
    with errors_in_one_line():
        saved = use_experiment(name)
        if saved:
            typer.echo(f"the edited {PARAMS} is saved as {saved}")


def tidy() -> None:
    """Remove outputs of folds and seeds that params.yaml does not define.

    Needed after an edit of ``runs`` in params.yaml, as scores are pooled over all files.
    """
    with errors_in_one_line():
        for path in remove_unused_outputs():
            typer.echo(f"removed {path}")


def list_experiments() -> None:
    """List the experiments."""
    for name in experiment_names():
        typer.echo(name)
