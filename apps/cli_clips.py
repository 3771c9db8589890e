"""``pacmo clips`` and ``pacmo quarantine``: what stands in a folder of the store."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from pacmo_core.project.workspace import CommandError, errors_in_one_line
from pacmo_core.store.files import StoreError
from pacmo_core.store.tables import ClipRecord, QuarantineRecord, SplitRecord, read_rows

Folder = Annotated[Path, typer.Argument(help="such as data/clips or data/sequences")]
Matching = Annotated[str, typer.Option(help="only rows that hold this text")]

Sides = Annotated[
    Path | None, typer.Option(help="show the side of each clip, such as data/splits/1.parquet")
]

CLIP_COLUMNS = ("clip", "action", "subject_a", "subject_b", "fps", "frames", "duration")


def list_clips(
    folder: Folder = Path("data/clips"), matching: Matching = "", sides: Sides = None
) -> None:
    """List the clips of a folder.

    Who, what, how long; with ``--splits`` on which side in that fold.
    """
    with _told():
        rows = read_rows(folder / "clips.parquet", ClipRecord)
        stands = {row.clip: row.split for row in read_rows(sides, SplitRecord)} if sides else {}
    cells = [[_cell(getattr(row, column)) for column in CLIP_COLUMNS] for row in rows]
    if sides:
        cells = [[*line, stands.get(row.clip, "")] for line, row in zip(cells, rows, strict=True)]
    _show(cells, (*CLIP_COLUMNS, *(["split"] if sides else [])), matching)


def list_quarantine(folder: Folder = Path("data/sequences"), matching: Matching = "") -> None:
    """List captures that could not be used.

    With the file, the line and the reason.
    """
    with _told():
        rows = read_rows(folder / "quarantine.parquet", QuarantineRecord)
    columns = ("file", "line", "reason")
    _show([[_cell(getattr(row, column)) for column in columns] for row in rows], columns, matching)


@contextmanager
def _told() -> Iterator[None]:
    with errors_in_one_line():
        try:
            yield
        except StoreError as fault:
            raise CommandError(str(fault)) from fault


def _show(lines: Sequence[Sequence[str]], columns: Sequence[str], matching: str) -> None:
    table = Table(*columns, box=None)
    for cells in lines:
        if matching in " ".join(cells):
            table.add_row(*cells)
    Console().print(table)
    typer.echo(f"{table.row_count} of {len(lines)}")


def _cell(value: object) -> str:
    return f"{value:.2f}" if isinstance(value, float) else str(value)
