"""The console command ``pacmo``: the door for people, and its table of contents."""

import typer

from apps import (
    cli_augment,
    cli_clips,
    cli_export,
    cli_fetch,
    cli_react,
    cli_report,
    cli_status,
    cli_study,
    cli_use,
    cli_vary,
    cli_view,
)

app = typer.Typer(
    name="pacmo",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    epilog="Exit codes: 0 done; 1 could not be done, with the reason in one line; 2 wrong usage.",
)
app.add_typer(cli_fetch.app, name="fetch")
app.add_typer(cli_study.app, name="study")
app.command("use")(cli_use.use)
app.command("tidy")(cli_use.tidy)
app.command("experiments")(cli_use.list_experiments)
app.command("react")(cli_react.react_to)
app.command("report")(cli_report.report)
app.command("view")(cli_view.view)
app.command("export")(cli_export.export_clip)
app.command("augment")(cli_augment.augment)
app.command("vary")(cli_vary.vary)
app.command("clips")(cli_clips.list_clips)
app.command("status")(cli_status.show_status)
app.command("rollback")(cli_status.roll_back_model)
app.command("quarantine")(cli_clips.list_quarantine)


@app.callback()
def about() -> None:
    """Two-person motion: real captures in, the reaction of the second person out.

    ``pacmo COMMAND --help`` says what a command does, with examples.
    """


if __name__ == "__main__":
    app(prog_name="pacmo")
