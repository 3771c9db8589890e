"""Objects of DVC's cache, and those whose content does not have the hash in their name.

DVC trusts a write-protected object. As files of the workspace are links to objects, a change of one
changes the object too, and DVC would restore what is corrupt.

Hashing takes seconds a gigabyte. What was hashed is remembered by inode, size and times: any write
through the file system sets the time of change, which no program can set back. A disk that changes
bytes by itself is found by hashing all, as the nightly flow does.
"""

import hashlib
import json
import logging
import os
from collections.abc import Iterator
from pathlib import Path

from ruamel.yaml import YAML

from pacmo_core.project.workspace import DVC_CACHE, DVC_LOCK, HISTORY, log_event
from pacmo_core.store.files import write_text

OBJECTS = DVC_CACHE / "files" / "md5"
VERIFIED = HISTORY / "objects.json"
Facts = list[int]  # inode, size, and the times of modification and of change in ns


def cache_objects() -> Iterator[Path]:
    """Yield the objects in the order of their hashes."""
    return (path for path in sorted(OBJECTS.glob("[0-9a-f][0-9a-f]/*")) if path.is_file())


def object_hash(path: Path) -> str:
    """Return the hash in an object's name; that of a folder ends in ``.dir``."""
    return path.parent.name + path.name


def is_in_cache(hash_: str) -> bool:
    """Whether the cache has an object, and of a folder all files that it lists."""
    path = OBJECTS / hash_[:2] / hash_[2:]
    if not path.is_file():
        return False
    if not hash_.endswith(".dir"):
        return True
    return all(is_in_cache(entry["md5"]) for entry in json.loads(path.read_text("utf-8")))


def corrupt_objects(*, skip_verified: bool = False) -> list[Path]:
    """List the objects whose content does not have the hash in their name.

    Parameters
    ----------
    skip_verified : do not hash again what has not changed since it was hashed last
    """
    verified = _read_verified()
    corrupt, facts = [], dict[str, Facts]()
    for path in cache_objects():
        name, present = object_hash(path), _facts(path)
        is_known = skip_verified and verified.get(name) == present
        if is_known or _md5(path) == name.removesuffix(".dir"):
            facts[name] = present
        else:
            corrupt.append(path)
    if facts != verified:
        write_text(VERIFIED, json.dumps(facts) + "\n")
    return corrupt


def remove_corrupt_objects(*, skip_verified: bool = False) -> list[str]:
    """Remove corrupt objects, so that DVC makes them again; return their hashes.

    Files of the workspace may be links to the same content, with the size and time that DVC has
    stored. A new modification time makes DVC hash them.
    """
    corrupt = corrupt_objects(skip_verified=skip_verified)
    for path in corrupt:
        os.utime(path)
        path.unlink()
        log_event(
            f"removed {path}: its content is corrupt; what needs it is made again", logging.WARNING
        )
    if corrupt:
        _remove_dangling_outputs()
    return [object_hash(path) for path in corrupt]


def _remove_dangling_outputs() -> None:
    """Remove outputs that are symbolic links to removed objects, at which DVC would stop."""
    if not DVC_LOCK.exists():
        return
    stages = YAML(typ="safe").load(DVC_LOCK).get("stages", {})
    outputs = [Path(out["path"]) for stage in stages.values() for out in stage.get("outs", ())]
    for path in (path for output in outputs for path in (output, *output.rglob("*"))):
        if path.is_symlink() and not path.exists():
            path.unlink()


def _read_verified() -> dict[str, Facts]:
    try:
        content = json.loads(VERIFIED.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}  # missing or incomplete: hash all
    return content if isinstance(content, dict) else {}


def _facts(path: Path) -> Facts:
    facts = path.stat()
    return [facts.st_ino, facts.st_size, facts.st_mtime_ns, facts.st_ctime_ns]


def _md5(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "md5").hexdigest()
