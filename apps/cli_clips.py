"""``pacmo clips`` and ``pacmo quarantine``: what stands in a folder of the store."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from apps.failure import CommandError, told_in_one_line
from pacmo_core.store.clips import ClipFacts, QuarantineFacts, read_rows
from pacmo_core.store.schema import StoreError

Folder = Annotated[Path, typer.Argument(help="such as data/clips or data/sequences")]
Matching = Annotated[str, typer.Option(help="only rows that hold this text")]

CLIP_COLUMNS = ("clip", "side", "action", "subject_a", "subject_b", "fps", "frames", "duration")


def list_clips(folder: Folder = Path("data/clips"), matching: Matching = "") -> None:
    """List the clips of a folder.

    Who, what, how long, on which side.
    """
    with _told():
        rows = read_rows(folder / "clips.parquet", ClipFacts)
    _show(rows, CLIP_COLUMNS, matching)


def list_quarantine(folder: Folder = Path("data/sequences"), matching: Matching = "") -> None:
    """List captures that could not be used.

    With the file, the line and the reason.
    """
    with _told():
        rows = read_rows(folder / "quarantine.parquet", QuarantineFacts)
    _show(rows, ("file", "line", "reason"), matching)


@contextmanager
def _told() -> Iterator[None]:
    with told_in_one_line():
        try:
            yield
        except StoreError as fault:
            raise CommandError(str(fault)) from fault


def _show(rows: Sequence[object], columns: tuple[str, ...], matching: str) -> None:
    table = Table(*columns, box=None)
    for row in rows:
        cells = [_cell(getattr(row, column)) for column in columns]
        if matching in " ".join(cells):
            table.add_row(*cells)
    Console().print(table)
    typer.echo(f"{table.row_count} of {len(rows)}")


def _cell(value: object) -> str:
    return f"{value:.2f}" if isinstance(value, float) else str(value)
