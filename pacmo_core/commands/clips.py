"""``pacmo clips`` and ``pacmo quarantine``: the tables of a folder of clips."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Annotated

import typer

from pacmo_core.data.limits import printable
from pacmo_core.data.names import ReactionName, is_reaction
from pacmo_core.formats.registry import format_of
from pacmo_core.formats.table_parquet import is_clip_file
from pacmo_core.project.workspace import (
    MOTIONS,
    VARIATIONS_FOLDER,
    CommandError,
    errors_in_one_line,
    in_project,
)
from pacmo_core.store.files import StoreError
from pacmo_core.store.motions import read_names
from pacmo_core.store.tables import (
    VARIATIONS,
    ClipRecord,
    QuarantineRecord,
    SplitRecord,
    read_rows,
    read_variations,
)

CLIPS, SEQUENCES = in_project(Path("data/clips")), in_project(Path("data/sequences"))
Folder = Annotated[Path, typer.Argument(help="such as data/clips, or FILE.parquet")]
Folders = Annotated[
    list[Path] | None, typer.Argument(help="such as data/clips, or several FILE.parquet")
]
Matching = Annotated[str, typer.Option(help="only rows that contain this text")]

Splits = Annotated[
    Path | None, typer.Option(help="show the split of each clip, such as data/splits/1.parquet")
]

ReactionsFolder = Annotated[
    Path | None,
    typer.Option(help="folder of FOLD/MODEL/SEED; default: reactions beside the folder of clips"),
]

Variations = Annotated[
    bool, typer.Option("--variations", help="list variations of clips, beside the folder")
]

VARIATION_COLUMNS = ("variation", "kind", "accepted", "limit_ratio", "reason")
CLIP_COLUMNS = ("clip", "action", "subject_a", "subject_b", "fps", "frames", "duration")


def clips(
    folders: Folders = None,
    matching: Matching = "",
    splits: Splits = None,
    reactions: ReactionsFolder = None,
    variations: Variations = False,
) -> None:
    """List the clips of a folder or of Parquet files.

    pacmo clips

    pacmo clips reactions.parquet others.parquet

    pacmo clips --splits data/splits/1.parquet --matching test

    pacmo clips --variations

    Their people, action and duration; the models that have reactions to them; with ``--splits``
    also their split in that fold. A reaction of person b, of model pacmo in fold 1 with seed 1, is
    data/reactions/1/pacmo/1:CLIP#b#0 for ``pacmo view`` and ``pacmo export``. ``--variations``
    lists those of all datasets in data/variations, accepted or not, by the names that both take.
    Of a folder of captures that no run has taken in, the files and their formats are listed, with
    those below it.
    """
    folder, *others = folders or [CLIPS]
    _check_alone(others, {"--variations": variations, "--splits": splits, "--reactions": reactions})
    if variations:
        _list_variations(folder.parent / VARIATIONS_FOLDER.name, matching)
        return
    with _errors_in_one_line():
        if others or folder.is_file():
            _list_files([folder, *others], matching)
            return
        if not (folder / "clips.parquet").exists() and (folder / MOTIONS).is_file():
            _list_files([folder / MOTIONS], matching)
            return
        if not (folder / "clips.parquet").exists() and (captures := _captures(folder)):
            _show(captures, ("capture", "format"), matching)
            return
        rows = read_rows(_table(folder / "clips.parquet"), ClipRecord)
        split_of = {row.clip: row.split for row in read_rows(splits, SplitRecord)} if splits else {}
        models = _models_by_clip(reactions or folder.parent / "reactions")
    columns = (*CLIP_COLUMNS, *(["reactions"] if models else []), *(["split"] if splits else []))
    cells = []
    for row in rows:
        more = {
            "reactions": " ".join(models.get(row.clip, [])),
            "split": split_of.get(row.clip, ""),
        }
        cells.append([_cell(more.get(name, getattr(row, name, ""))) for name in columns])
    _show(cells, columns, matching)


def _check_alone(others: Sequence[Path], options: Mapping[str, object]) -> None:
    """Refuse further files beside options of one folder."""
    with errors_in_one_line():
        if others and (given := [name for name, value in options.items() if value]):
            raise CommandError(f"{given[0]} is of one folder; got {others[0]} too")


def _list_files(files: Sequence[Path], matching: str) -> None:
    """List the clips of Parquet files, as view and export take them."""
    for file in files:
        if not file.exists():
            raise CommandError(f"no {file}")
        if not file.is_file() or file.suffix.lower() != ".parquet" or not is_clip_file(file):
            raise CommandError(
                f"{file}: wanted one folder, or Parquet files of clips; "
                "a capture has no names of clips"
            )
    lines = [[printable(f"{file}:{name}")] for file in files for name in read_names(file)]
    _show(lines, ("clip",), matching)


def _captures(folder: Path) -> list[list[str]]:
    """List the files in and below a folder whose suffix is that of a format of captures."""
    found = []
    for file in sorted(folder.rglob("*")):
        if not file.is_file() or any(part[:1] == "." for part in file.relative_to(folder).parts):
            continue
        with suppress(ValueError):
            found.append([printable(str(file)), format_of(file)])
    return found


def _list_variations(folder: Path, matching: str) -> None:
    """List the variations of every dataset in a folder."""
    with _errors_in_one_line():
        tables = sorted(folder.glob(f"*/{VARIATIONS}"))
        if not tables:
            raise CommandError(f"no {folder / '*' / VARIATIONS}: ./run makes it")
        rows = [row for table in tables for row in read_variations(table)]
    cells = [[_cell(getattr(row, column)) for column in VARIATION_COLUMNS] for row in rows]
    _show(cells, VARIATION_COLUMNS, matching)


def _table(path: Path) -> Path:
    """Return the path of a table that is there.

    Raises
    ------
    CommandError
        If it is not: before the first run, or in another folder.
    """
    if not path.exists():
        raise CommandError(
            f"no {path}: ./run makes data/clips and data/sequences; "
            f"wanted a folder with {path.name}, a Parquet file, or a folder of captures by suffix"
        )
    return path


def _models_by_clip(folder: Path) -> dict[str, list[str]]:
    """List the models that have reactions to each clip, of all folds and seeds.

    Parameters
    ----------
    folder : with ``FOLD/MODEL/SEED/motions.parquet``
    """
    found: dict[str, list[str]] = {}
    for file in sorted(folder.glob(f"*/*/*/{MOTIONS}"), key=lambda file: file.parts[-3]):
        model = file.parts[-3]
        names = {ReactionName.parse(name).clip for name in read_names(file) if is_reaction(name)}
        for clip in names:
            models = found.setdefault(clip, [])
            if model not in models:
                models.append(model)
    return found


def quarantine(
    folder: Folder = SEQUENCES,
    matching: Matching = "",
) -> None:
    """List captures that could not be used.

    With the file, the line and the reason.
    """
    with _errors_in_one_line():
        rows = read_rows(_table(folder / "quarantine.parquet"), QuarantineRecord)
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
    """Print the lines in columns; nothing is cut to the width of a terminal."""
    shown = [cells for cells in lines if matching in " ".join(cells)]
    widths = [max(map(len, column)) for column in zip(columns, *shown, strict=True)]
    for cells in (columns, *shown):
        padded = (cell.ljust(width) for cell, width in zip(cells, widths, strict=True))
        typer.echo("  ".join(padded).rstrip())
    typer.echo(f"{len(shown)} of {len(lines)}")


def _cell(value: object) -> str:
    # Escaped: a name may hold controls of the terminal.
    return f"{value:.2f}" if isinstance(value, float) else printable(str(value))
