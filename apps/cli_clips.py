"""``pacmo clips`` and ``pacmo quarantine``: what stands in a folder of the store."""

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
    """List the clips of a folder: who, what, how long, on which side."""
    _show(folder / "clips.parquet", ClipFacts, CLIP_COLUMNS, matching)


def list_quarantine(folder: Folder = Path("data/sequences"), matching: Matching = "") -> None:
    """List the captures that could not be used, with the reasons."""
    _show(folder / "quarantine.parquet", QuarantineFacts, ("file", "line", "reason"), matching)


def _show(
    path: Path,
    kind: type[ClipFacts] | type[QuarantineFacts],
    columns: tuple[str, ...],
    matching: str,
) -> None:
    table = Table(*columns, box=None)
    with told_in_one_line():
        try:
            rows = read_rows(path, kind)
        except StoreError as fault:
            raise CommandError(str(fault)) from fault
    cells = [[_cell(getattr(row, column)) for column in columns] for row in rows]
    for line in cells:
        if matching in " ".join(line):
            table.add_row(*line)
    Console().print(table)
    typer.echo(f"{table.row_count} of {len(rows)}")


def _cell(value: object) -> str:
    return f"{value:.2f}" if isinstance(value, float) else str(value)
