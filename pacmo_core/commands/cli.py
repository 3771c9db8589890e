"""The console command ``pacmo``: its list of commands, each imported when it is called.

The help of the list is written here, so that ``pacmo --help`` imports no command: some of them
import torch. A further command is a function in a module of this package and a row here.
"""

import sys
from collections import Counter
from collections.abc import Sequence
from importlib import import_module
from typing import Any

import typer
from typer.core import TyperGroup

from pacmo_core.data.names import nearest_names
from pacmo_core.project.workspace import enter_project

# Name: module of this package, function or typer application in it, first line of its help.
COMMANDS = {
    "fetch": ("fetch", "app", "Download a public dataset."),
    "use": ("workspace", "use", "Write the parameters of an experiment to params.yaml."),
    "experiments": ("workspace", "experiments", "List the experiments."),
    "clips": ("clips", "clips", "List the clips of a folder."),
    "quarantine": ("clips", "quarantine", "List captures that could not be used."),
    "react": ("react", "react", "Generate reactions to a partner's motion."),
    "augment": ("augment", "augment", "Retarget two people's motion to other bodies."),
    "vary": ("vary", "vary", "Retarget two people's motion by a trained skeleton prior."),
    "view": ("view", "view", "Show clips side by side in a page that plays them."),
    "export": ("export", "export", "Write a clip in another tool's format."),
    "study": (
        "study",
        "app",
        "Run a perceptual study: can people distinguish generated from captured motion?",
    ),
    "report": ("report", "report", "Write the report with the history of runs and decisions."),
    "status": (
        "workspace",
        "status",
        "Show the last runs, the current model, stale stages, inbox, quarantine and disk.",
    ),
    "rollback": ("workspace", "rollback", "Make the previously promoted model current again."),
    "tidy": (
        "workspace",
        "tidy",
        "Remove outputs of folds and seeds that params.yaml does not define.",
    ),
}
# They work on the whole project, wherever the user stands.
OF_PROJECT = ("use", "experiments", "status", "rollback", "tidy")
_OPTIONS: dict[str, Any] = {
    "add_completion": False,
    "rich_markup_mode": None,
    "pretty_exceptions_enable": False,
}
PIPELINE_MODULES = ("dvc", "prefect", "ruamel", "networkx", "fastapi", "uvicorn")


class LazyGroup(TyperGroup):
    """A group whose commands are imported when they are called."""

    def list_commands(self, ctx: Any) -> list[str]:  # noqa: ARG002  # typer's interface
        """List the commands in the order of the help."""
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:  # noqa: ARG002  # typer's interface
        """Import a command; None if there is none of this name."""
        if cmd_name not in COMMANDS:
            return None
        module, attribute, _ = COMMANDS[cmd_name]
        if cmd_name in OF_PROJECT:
            enter_project()
        target = getattr(import_module(f"pacmo_core.commands.{module}"), attribute)
        if not isinstance(target, typer.Typer):
            application = typer.Typer(**_OPTIONS)
            application.command(cmd_name)(target)
            target = application
        command = typer.main.get_command(target)
        command.name = cmd_name
        return command

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find the command; name the nearest of a wrong name, and refuse repeated options."""
        name = args[0]
        if name not in COMMANDS and (near := nearest_names(name, COMMANDS)):
            ctx.fail(f"No such command {name!r}; did you mean {' or '.join(near)}?")
        found = super().resolve_command(ctx, args)
        _refuse_repeats(found[1], args[1:], ctx)
        return found

    def format_commands(self, ctx: Any, formatter: Any) -> None:  # noqa: ARG002
        """Write the list of commands without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, help_) for name, (_, _, help_) in COMMANDS.items()])


def _refuse_repeats(command: Any, words: Sequence[str], parent: Any) -> None:
    """Refuse an option of one value that is given twice, of which the last would count."""
    # Resilient: what else is wrong with the words, the command says itself.
    ctx = command.context_class(
        command, info_name=command.name, parent=parent, resilient_parsing=True
    )
    _, rest, given = command.make_parser(ctx).parse_args(list(words))
    for option, times in Counter(given).items():
        if option.param_type_name == "option" and not option.multiple and times > 1:
            name = "/".join([*option.opts, *option.secondary_opts])
            ctx.fail(f"{name}: wanted once; got {times} times")
    if isinstance(command, TyperGroup) and rest:
        inner = command.get_command(ctx, rest[0])
        if inner:
            _refuse_repeats(inner, rest[1:], ctx)


app = typer.Typer(
    name="pacmo",
    cls=LazyGroup,
    no_args_is_help=True,
    epilog="Exit codes: 0 done; 1 could not be done, with the reason in one line; 2 words that the "
    "command does not take.",
    **_OPTIONS,
)


@app.callback()
def about() -> None:
    """Two-person motion: generate the reaction to a partner, retarget both people to other bodies.

    ``pacmo COMMAND --help`` describes a command, with examples.
    """


def main() -> None:
    """Run the command line; name the extra that a missing package belongs to."""
    try:
        app(prog_name="pacmo")
    except ModuleNotFoundError as missing:
        package = (missing.name or "").partition(".")[0]
        if package not in PIPELINE_MODULES:
            raise
        sys.stderr.write(
            f"pacmo: this command needs {package}; install it with: pip install 'pacmo[pipeline]'\n"
        )
        raise SystemExit(1) from None


if __name__ == "__main__":
    main()
