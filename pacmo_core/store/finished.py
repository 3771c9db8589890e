"""Clips that are finished: their files and rows as they were written, to be copied.

A file a clip, under the hash of all that its files and rows rest on. It is written whole or not at
all, and bears its own hash: one that was damaged since is found, and made again.
"""

import hashlib
import json
import logging
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from pacmo_core.store.atomic import whole_file
from pacmo_core.store.motion_folders import file_of
from pacmo_core.store.variations import VariationFacts

LOG = logging.getLogger(__name__)
ROWS = "rows"


@dataclass(frozen=True)
class FinishedClip:
    """What a clip comes to in a family's folder.

    Parameters
    ----------
    rows : of its variations
    files : Parquet, by the folder that they stand in; none where a clip has nothing for one
    """

    rows: list[VariationFacts]
    files: dict[str, bytes]

    def place(self, family: Path, clip: str) -> None:
        """Write the files into a family's folder, each whole or not at all.

        They are not synced to the disk, as what they are copied from was.
        """
        for folder, data in self.files.items():
            path = file_of(family / folder, clip)
            path.parent.mkdir(parents=True, exist_ok=True)
            partial = path.with_name(f".{path.name}.{os.getpid()}")
            partial.write_bytes(data)
            partial.replace(path)


class Finished:
    """The clips that were finished before."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._used: set[Path] = set()

    def get(self, key: str) -> FinishedClip | None:
        """Give a clip, or none where there is none; a damaged one is removed."""
        path = self._path(key)
        if not path.exists():
            return None
        try:
            found = _read(path)
        except (SafetensorError, KeyError, TypeError, ValueError) as fault:
            LOG.warning("%s is damaged and will be made again (%s)", path, fault)
            path.unlink()
            return None
        self._used.add(path)
        return found

    def copy(self, key: str, family: Path, clip: str) -> list[VariationFacts] | None:
        """Place a clip's files and give its rows, or none where there is none."""
        found = self.get(key)
        if found is None:
            return None
        found.place(family, clip)
        return found.rows

    def keep(self, key: str, clip: FinishedClip) -> None:
        """Keep a clip."""
        rows = json.dumps([asdict(row) for row in clip.rows]).encode()
        held = {**clip.files, ROWS: rows}
        arrays = {name: np.frombuffer(data, np.uint8) for name, data in held.items()}
        path = self._path(key)
        with whole_file(path) as partial:
            save_file(arrays, partial, metadata={"sha256": _hash(arrays)})
        self._used.add(path)

    def forget_others(self) -> None:
        """Remove the clips that were neither given nor kept since this was opened."""
        for path in self._folder.glob("*.safetensors"):
            if path not in self._used:
                path.unlink()

    def _path(self, key: str) -> Path:
        return self._folder / f"{key}.safetensors"


def _read(path: Path) -> FinishedClip:
    """Read a clip.

    Raises
    ------
    SafetensorError
        If the file is cut short.
    ValueError
        If it is not what was written.
    """
    with safe_open(path, framework="numpy") as file:
        wanted = file.metadata()["sha256"]
        arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    if _hash(arrays) != wanted:
        raise ValueError("its content is not what was written")
    files = {name: array.tobytes() for name, array in arrays.items()}
    rows = [VariationFacts(**row) for row in json.loads(files.pop(ROWS))]
    return FinishedClip(rows, files)


def _hash(arrays: Mapping[str, NDArray[np.uint8]]) -> str:
    digest = hashlib.sha256()
    for name in sorted(arrays):
        digest.update(f"{name} {len(arrays[name])}\0".encode())
        digest.update(arrays[name].data)
    return digest.hexdigest()
