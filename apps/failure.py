"""Tell a person in one line what went wrong, where the fault is no bug of ours."""

from collections.abc import Iterator
from contextlib import contextmanager

import typer

from pacmo_core.formats.base import FormatError
from pacmo_core.store.files import StoreError

FAILED = 1  # exit code; typer's own 2 means wrong usage


class CommandError(Exception):
    """Something that a command could not do, in words that say what to do about it."""


@contextmanager
def told_in_one_line() -> Iterator[None]:
    """End a command with exit code 1 and one line on stderr where it could not do its work.

    That is a ``CommandError`` or a file that the system refuses. Anything else is a bug and
    keeps its traceback.
    """
    try:
        yield
    except CommandError as failure:
        message = str(failure)
    except OSError as error:
        message = f"{error.filename or 'file'}: {error.strerror or error}"
    else:
        return
    typer.echo(f"pacmo: {' '.join(message.split())}", err=True)
    raise typer.Exit(FAILED)


@contextmanager
def told_reading() -> Iterator[None]:
    """As ``told_in_one_line``, also for what the readers of files refuse."""
    with told_in_one_line():
        try:
            yield
        except (StoreError, FormatError) as fault:
            raise CommandError(str(fault)) from fault
        except (ValueError, KeyError) as fault:
            raise CommandError(str(fault.args[0])) from fault
