"""``pacmo clips`` and ``pacmo quarantine``: the tables of a folder of clips."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from pacmo_core.data.limits import printable
from pacmo_core.project.workspace import CommandError, errors_in_one_line
from pacmo_core.store.files import StoreError
from pacmo_core.store.tables import ClipRecord, QuarantineRecord, SplitRecord, read_rows

Folder = Annotated[Path, typer.Argument(help="such as data/clips or data/sequences")]
Matching = Annotated[str, typer.Option(help="only rows that contain this text")]

Splits = Annotated[
    Path | None, typer.Option(help="show the split of each clip, such as data/splits/1.parquet")
]

CLIP_COLUMNS = ("clip", "action", "subject_a", "subject_b", "fps", "frames", "duration")


def clips(
    folder: Folder = Path("data/clips"), matching: Matching = "", splits: Splits = None
) -> None:
    """List the clips of a folder.

    Their people, action and duration; with ``--splits`` also their split in that fold.
    """
    with _errors_in_one_line():
        rows = read_rows(folder / "clips.parquet", ClipRecord)
        split_of = {row.clip: row.split for row in read_rows(splits, SplitRecord)} if splits else {}
    cells = [[_cell(getattr(row, column)) for column in CLIP_COLUMNS] for row in rows]
    if splits:
        cells = [[*line, split_of.get(row.clip, "")] for line, row in zip(cells, rows, strict=True)]
    _show(cells, (*CLIP_COLUMNS, *(["split"] if splits else [])), matching)


def quarantine(folder: Folder = Path("data/sequences"), matching: Matching = "") -> None:
    """List captures that could not be used.

    With the file, the line and the reason.
    """
    with _errors_in_one_line():
        rows = read_rows(folder / "quarantine.parquet", QuarantineRecord)
    columns = ("file", "line", "reason")
    _show([[_cell(getattr(row, column)) for column in columns] for row in rows], columns, matching)


@contextmanager
def _errors_in_one_line() -> Iterator[None]:
    with errors_in_one_line():
        try:
            yield
        except StoreError as fault:
            raise CommandError(str(fault)) from fault


def _show(lines: Sequence[Sequence[str]], columns: Sequence[str], matching: str) -> None:
    table = Table(*columns, box=None)
    for cells in lines:
        if matching in " ".join(cells):
            table.add_row(*map(Text, cells))
    Console().print(table)
    typer.echo(f"{table.row_count} of {len(lines)}")


def _cell(value: object) -> str:
    # Escaped: a name may hold controls of the terminal, and brackets that Rich takes as markup.
    return f"{value:.2f}" if isinstance(value, float) else printable(str(value))
