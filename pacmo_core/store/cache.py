"""A content-addressed cache of arrays: what a stage computed before, under the hash of its inputs.

Used within a stage where DVC caches the whole stage only: readings of raw captures
(``pacmo_core.ingestion``), variations and the files of varied clips (``pacmo_core.augmentation``).
The result of a stage is the same bytes with the cache and without it.

An entry is one safetensors file, ``FOLDER/NAMESPACE/KEY.safetensors``. The namespace is the hash of
settings and code (``code_hash``), the key the hash of the input. Each file is written atomically
and contains the hash of its own content: a damaged entry is deleted and computed again.
"""

import errno
import hashlib
import json
import logging
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

import pacmo_core
from pacmo_core.store.files import atomic_file

LOG = logging.getLogger(__name__)
HASH_LENGTH = 32  # hexadecimal characters of a key
SUFFIX = ".safetensors"


@dataclass(frozen=True)
class CacheEntry:
    """A cached result.

    Parameters
    ----------
    metadata : what JSON can represent
    arrays : by name
    """

    metadata: Any
    arrays: Mapping[str, NDArray[Any]]


class Cache:
    """The entries of one namespace.

    Parameters
    ----------
    folder : of all namespaces
    namespace : hash of the settings and the code that compute the entries
    """

    def __init__(self, folder: Path, namespace: str) -> None:
        self._folder, self._namespace = folder, folder / namespace
        self._used: set[Path] = set()

    def get(self, key: str) -> CacheEntry | None:
        """Read an entry; None if there is none. A damaged entry is deleted with a warning."""
        path = self.path(key)
        if not path.exists():
            return None
        try:
            entry = _read(path)
        except (SafetensorError, KeyError, TypeError, ValueError) as error:
            LOG.warning("%s is damaged and will be computed again (%s)", path, error)
            path.unlink()
            return None
        self._used.add(path)
        return entry

    def put(self, key: str, entry: CacheEntry) -> None:
        """Write an entry."""
        metadata = json.dumps(entry.metadata)
        header = {"metadata": metadata, "sha256": _content_hash(metadata, entry.arrays)}
        path = self.path(key)
        # Not flushed to the disk: after a power failure the hash reveals what was lost.
        with atomic_file(path, sync=False) as partial:
            try:
                save_file(dict(entry.arrays), partial, metadata=header)
            except SafetensorError as error:  # a full disk
                raise OSError(errno.EIO, str(error)) from error
        self._used.add(path)

    def path(self, key: str) -> Path:
        """Return the file of an entry; a key may contain ``/``."""
        return self._namespace / f"{key}{SUFFIX}"

    def remove_unused(self) -> None:
        """Delete the entries that were neither read nor written through this object."""
        for path in self._namespace.rglob(f"*{SUFFIX}"):
            if path not in self._used:
                path.unlink()

    def remove_other_namespaces(self) -> None:
        """Delete the entries that other code or settings computed."""
        for other in self._folder.iterdir() if self._folder.is_dir() else ():
            if other != self._namespace and other.is_dir():
                shutil.rmtree(other)


@cache
def code_hash(patterns: tuple[str, ...], packages: tuple[str, ...]) -> str:
    """Hash source files and the versions of packages.

    Computed once a process: what runs is the code that the process imported, whatever is edited
    while it runs.

    Parameters
    ----------
    patterns : of files below ``pacmo_core``, such as ``formats/*.py``
    packages : names of distributions

    Raises
    ------
    ValueError
        If a pattern matches no file.
    """
    digest = hashlib.sha256()
    for package in packages:
        digest.update(f"{package} {version(package)}\0".encode())
    root = Path(pacmo_core.__path__[0])
    for pattern in patterns:
        paths = sorted(root.glob(pattern))
        if not paths:
            raise ValueError(f"{root}: wanted files that match {pattern}, got none")
        for path in paths:
            digest.update(f"{path.relative_to(root)}\0".encode() + path.read_bytes() + b"\0")
    return digest.hexdigest()


def short_hash(*parts: str | bytes) -> str:
    """Hash texts and bytes to a key."""
    digest = hashlib.sha256()
    for part in parts:
        data = part.encode() if isinstance(part, str) else part
        digest.update(f"{len(data)}\0".encode() + data)
    return digest.hexdigest()[:HASH_LENGTH]


def _read(path: Path) -> CacheEntry:
    """Read an entry and check its hash.

    Raises
    ------
    SafetensorError
        If the file is cut short.
    ValueError
        If the content is not what was written.
    """
    with safe_open(path, framework="numpy") as file:
        header = file.metadata()
        arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    if _content_hash(header["metadata"], arrays) != header["sha256"]:
        raise ValueError("the content does not match its hash")
    return CacheEntry(json.loads(header["metadata"]), arrays)


def _content_hash(metadata: str, arrays: Mapping[str, NDArray[Any]]) -> str:
    digest = hashlib.sha256(metadata.encode())
    for name in sorted(arrays):
        array = arrays[name]
        digest.update(f"\0{name} {array.dtype} {array.shape}\0".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
