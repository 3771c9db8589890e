"""``pacmo report``: the run's page, and beside it what is known from elsewhere."""

from pathlib import Path
from typing import Annotated

import typer

from apps.whole_page import write_whole
from pacmo_core.project.workspace import REPORT_WITH_HISTORY, errors_in_one_line

Out = Annotated[Path, typer.Option(help="the page")]


def report(out: Out = REPORT_WITH_HISTORY) -> None:
    """Write the run's page with the history of runs and decisions, the study, every command.

    reports/report.html rests on its run alone. This page is the same and holds beside it what
    other runs measured (each time this is called, the run that stands here is remembered), the
    decisions of the nights, history/study.json if there is one, and dvc.lock in full.
    """
    with errors_in_one_line():
        typer.echo(f"{write_whole(out)}")
