"""Atomic file writes, file hashes, and the error of a file that cannot be read."""

import hashlib
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

_MAX_NAME = 200  # bytes; file systems take names of 255


class StoreError(ValueError):
    """A file that this package did not write, that is cut short, or of another version."""


@contextmanager
def atomic_file(path: Path, *, sync: bool = True) -> Iterator[Path]:
    """Yield a temporary path beside ``path`` and rename it to ``path`` when the block succeeds.

    After an interrupted process the file has its old content or its new content, complete; after
    an exception in the block it has its old content. The temporary name contains the process
    number, so that a child process that outlives its parent cannot write into the file of the
    next run. Two threads of one process must not write the same path.

    Parameters
    ----------
    sync : flush file and folder to the disk (fsync), so that the file survives a power failure
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{_short_name(path.name)}.{os.getpid()}")
    try:
        yield partial
        if sync:
            fsync(partial)
        partial.replace(path)
        if sync:
            fsync(path.parent)
    except OSError as error:
        # A write on a full disk names no file.
        if error.errno is not None and error.filename is None:
            error.filename = str(path)
        raise
    finally:
        partial.unlink(missing_ok=True)


def _short_name(name: str) -> str:
    """Shorten a name to which the number of a process can be added, with a hash for its rest."""
    encoded = os.fsencode(name)
    if len(encoded) <= _MAX_NAME:
        return name
    digest = hashlib.sha256(encoded).hexdigest()[:16]
    return os.fsdecode(encoded[: _MAX_NAME - len(digest)]) + digest


def write_text(path: Path, text: str) -> None:
    """Write UTF-8 text atomically."""
    with atomic_file(path) as partial:
        partial.write_text(text, encoding="utf-8")


def fsync(path: Path) -> None:
    """Flush a file or a folder to the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def file_hash(*paths: Path) -> str:
    """SHA-256 of the content of files, one after the other, in hexadecimal."""
    digest = hashlib.sha256()
    for path in paths:
        with path.open("rb") as file:
            while block := file.read(1 << 20):
                digest.update(block)
    return digest.hexdigest()


def default_params_file() -> Path:
    """Return the packaged ``params.yaml``; in a checkout the root's, its only copy."""
    package = Path(__file__).parents[1]
    packaged = package / "params.yaml"
    return packaged if packaged.exists() else package.parent / "params.yaml"


def merge_params(values: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return parameters with some of them replaced, at every depth; neither argument changes."""
    merged = dict(values)
    for key, value in changes.items():
        old = merged.get(key)
        if isinstance(old, Mapping) and isinstance(value, Mapping):
            merged[key] = merge_params(old, value)
        else:
            merged[key] = value
    return merged
