"""``pacmo use`` and ``pacmo experiments``: which experiment ``params.yaml`` holds."""

from typing import Annotated

import typer

from apps.experiments import experiment_names, tidy, use
from apps.failure import told_in_one_line


def use_experiment(
    name: Annotated[str, typer.Argument(help="a file in experiments/, without its ending")],
    discard: Annotated[
        bool, typer.Option("--discard", help="lose edits by hand of params.yaml")
    ] = False,
) -> None:
    """Choose the experiment that params.yaml holds.

    ``dvc repro`` then reproduces it. What folds and seeds of another left is removed; DVC's cache
    keeps it.
    """
    with told_in_one_line():
        use(name, discard=discard)


def tidy_runs() -> None:
    """Remove what other folds and seeds left.

    For after an edit of ``runs`` in params.yaml: scores are pooled from all that stand there.
    """
    with told_in_one_line():
        for path in tidy():
            typer.echo(f"removed {path}")


def list_experiments() -> None:
    """List the experiments."""
    for name in experiment_names():
        typer.echo(name)
