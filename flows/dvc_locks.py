"""DVC's list of who reads and writes what, less those who died.

DVC forgets holders whose process number is free. One that was killed and that nobody has waited
for yet (in a container without an init, nobody ever does) keeps its number, and its locks.
"""

import json
from pathlib import Path
from typing import Any

from apps.lock import PROC, lives
from pacmo_core.store.atomic import write_text

RWLOCK = Path(".dvc/tmp/rwlock")


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
