"""Folders of motions: a file a clip, which holds the clip, or all its variations.

So that one more clip is one more file, and the others stay as they are. What stands in a folder is
in ``motions``' own format; Polars reads all of it as ``FOLDER/*.parquet``.
"""

from collections.abc import Iterable, Iterator
from pathlib import Path
from urllib.parse import quote, unquote

from pacmo_core.data.interaction import Interaction
from pacmo_core.store.motions import stream_motions

# Between a clip's name and what was made of it; sorts after every character of a clip's name.
SEPARATOR = "~"
SUFFIX = ".parquet"


def file_of(folder: Path, clip: str) -> Path:
    """Say where a clip's motions stand; names with ``/`` stay in one folder."""
    return folder / f"{quote(clip, safe='#')}{SUFFIX}"


def clip_of(file: Path) -> str:
    """Say whose motions a file holds."""
    return unquote(file.name.removesuffix(SUFFIX))


def in_order(clips: Iterable[str]) -> list[str]:
    """Sort clips so that the names of their variations ascend: ``one#0001~x`` before ``one~x``."""
    return sorted(clips, key=lambda clip: f"{clip}{SEPARATOR}")


def stream_folder(folder: Path) -> Iterator[tuple[str, Interaction]]:
    """Yield all motions of a folder of variations in ascending order of their names.

    Raises
    ------
    FileNotFoundError
        If there is no such folder.
    StoreError
        If a file is not one of this store.
    """
    if not folder.is_dir():
        raise FileNotFoundError(f"{folder}: no folder of motions")
    for clip in in_order(clip_of(file) for file in folder.glob(f"*{SUFFIX}")):
        yield from stream_motions(file_of(folder, clip))
