"""DVC's cache: find objects that are no longer what their names say, and remove old ones.

DVC trusts an object that is write-protected and does not hash it again, so that one which a disk
has spoilt would be handed out for ever.
"""

import hashlib
import json
import os
import re
import time
from collections.abc import Iterator
from pathlib import Path

from ruamel.yaml import YAML

from apps.places import DVC_CACHE

OBJECTS = DVC_CACHE / "files" / "md5"
RUN_CACHE = DVC_CACHE / "runs"
_HASH = re.compile(r"\b[0-9a-f]{32}(?:\.dir)?\b")
_DAY = 86400.0


def spoilt_objects() -> list[Path]:
    """List the objects whose content is not that of their name."""
    return [path for path in _objects() if _md5(path) != _name_of(path).removesuffix(".dir")]


def remove_spoilt() -> list[str]:
    """Remove spoilt objects, and have DVC look again at the files of the workspace that they are.

    Those are links to the same content, with the size and time that DVC remembers: a new time
    makes it hash them, and make them anew.

    Returns
    -------
    their names
    """
    found = spoilt_objects()
    for path in found:
        os.utime(path)
        path.unlink()
    return [_name_of(path) for path in found]


def remove_old(days: float, locks: list[Path]) -> tuple[int, int]:
    """Remove objects and remembered runs that are older and that no lock file names.

    Parameters
    ----------
    days : age from which they go
    locks : ``dvc.lock`` files; what they name stays, whatever its age

    Returns
    -------
    how many objects, and how many bytes
    """
    kept = {name for lock in locks if lock.exists() for name in _names_in(lock)}
    kept |= {name for folder in kept if folder.endswith(".dir") for name in _members(folder)}
    old = [path for path in _objects() if _is_old(path, days) and _name_of(path) not in kept]
    size = sum(path.stat().st_size for path in old)
    for path in old:
        path.unlink()
    for path in RUN_CACHE.glob("*/*/*"):
        if path.is_file() and _is_old(path, days):
            path.unlink()
    return len(old), size


def _objects() -> Iterator[Path]:
    return (path for path in sorted(OBJECTS.glob("[0-9a-f][0-9a-f]/*")) if path.is_file())


def _name_of(path: Path) -> str:
    return path.parent.name + path.name


def _md5(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "md5").hexdigest()


def _is_old(path: Path, days: float) -> bool:
    # A time to come, which a clock that jumped has left, counts as young.
    return time.time() - path.stat().st_mtime > days * _DAY


def _names_in(lock: Path) -> set[str]:
    stages = YAML(typ="safe").load(lock)
    return set(_HASH.findall(json.dumps(stages)))


def _members(folder: str) -> list[str]:
    path = OBJECTS / folder[:2] / folder[2:]
    if not path.exists():
        return []
    return [entry["md5"] for entry in json.loads(path.read_text(encoding="utf-8"))]
