"""The shelf: every promoted model in a numbered folder of its own, and which one is current.

``current`` is a link to one of the folders, exchanged in one step: whoever reads through it sees
the old model or the new one, whole. What is on the shelf is a copy that DVC knows nothing of, so
that pruning its cache takes no promoted model away.
"""

import hashlib
import os
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path

CURRENT = "current"


def model_hash(files: Sequence[Path]) -> str:
    """SHA-256 of files of weights, in order."""
    if not files:
        raise ValueError("a model is at least one file of weights; got none")
    digest = hashlib.sha256()
    for file in files:
        digest.update(file.read_bytes())
    return digest.hexdigest()


def put(shelf: Path, number: int, files: Mapping[str, Path]) -> Path:
    """Copy files into a new folder of the shelf, whole or not at all.

    Parameters
    ----------
    shelf : the folder of all
    number : of the decision that promotes them
    files : what to copy, by the path that it gets

    Raises
    ------
    FileExistsError
        If the shelf has that number.
    """
    place = shelf / f"{number:06d}"
    if place.exists():
        raise FileExistsError(f"{place}: what is on the shelf stays as it is")
    partial = shelf / f".{place.name}"
    if partial.exists():
        shutil.rmtree(partial)  # a killed run's
    for name, file in files.items():
        (partial / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, partial / name)
        _sync(partial / name)
    partial.replace(place)
    _sync(shelf)
    return place


def numbers(shelf: Path) -> list[int]:
    """List what is on the shelf."""
    return sorted(int(place.name) for place in shelf.glob("[0-9]*") if place.is_dir())


def current(shelf: Path) -> int:
    """Give the number of the current model; 0 if none is."""
    link = shelf / CURRENT
    return int(link.readlink().name) if link.is_symlink() else 0


def make_current(shelf: Path, number: int) -> None:
    """Point ``current`` to a folder of the shelf.

    Raises
    ------
    FileNotFoundError
        If the shelf has no such number.
    """
    name = f"{number:06d}"
    if not (shelf / name).is_dir():
        raise FileNotFoundError(f"{shelf} holds no {name}; it holds {numbers(shelf)}")
    partial = shelf / f".{CURRENT}"
    partial.unlink(missing_ok=True)
    partial.symlink_to(name)
    partial.replace(shelf / CURRENT)
    _sync(shelf)


def remove(shelf: Path, number: int) -> None:
    """Take a folder off the shelf.

    Raises
    ------
    ValueError
        If it is current.
    """
    if number == current(shelf):
        raise ValueError(f"{shelf}: {number} is current")
    shutil.rmtree(shelf / f"{number:06d}")


def _sync(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
