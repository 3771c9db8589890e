"""What a killed DVC leaves and the next would stumble over.

Its list of who reads and writes what: DVC forgets holders whose process number is free. One that
was killed and that nobody has waited for yet (in a container without an init, nobody ever does)
keeps its number, and its locks. And ``dvc.lock``, which it writes in place.
"""

import json
import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from dvc.utils.strictyaml import YAMLSyntaxError, YAMLValidationError

from apps.lock import PROC, lives
from apps.log import tell
from pacmo_core.store.files import write_text

RWLOCK = Path(".dvc/tmp/rwlock")
DVC_LOCK = "dvc.lock"
CUT = "dvc.lock.cut"

Read = TypeVar("Read")


def past_a_cut_lock(read: Callable[[], Read]) -> Read:
    """Read what DVC says; a ``dvc.lock`` that a kill cut short is put aside first.

    DVC would refuse every command for it. Without it, its run cache gives back what stages made,
    and it is written anew. The caller holds the writers' lock, lest another DVC be writing it.
    """
    try:
        return read()
    except (YAMLSyntaxError, YAMLValidationError) as fault:
        path = Path(fault.path)
        if path.name != DVC_LOCK:
            raise
        path.replace(path.with_name(CUT))
        tell("dvc.lock was cut short and is put aside", logging.WARNING, path=CUT)
        return read()


def forget_the_dead(path: Path = RWLOCK) -> list[int]:
    """Take the dead off the list; the caller holds the writers' lock.

    A list that a kill cut short says nothing, and DVC would refuse it for ever: it is removed.

    Returns
    -------
    the process numbers of the dead
    """
    if not path.exists() or not PROC.is_dir():
        return []
    try:
        held: dict[str, dict[str, Any]] = json.loads(path.read_text(encoding="utf-8"))
    except ValueError:
        path.unlink()
        return []
    writers, readers = held.get("write", {}), held.get("read", {})
    infos = [*writers.values(), *(info for found in readers.values() for info in found)]
    dead = {info["pid"] for info in infos if info and not lives(info["pid"])}
    if dead:
        left = {
            "write": {name: info for name, info in writers.items() if info.get("pid") not in dead},
            "read": {
                name: [info for info in found if info["pid"] not in dead]
                for name, found in readers.items()
            },
        }
        write_text(path, json.dumps(left))
    return sorted(dead)
