"""The writer lock: one run at a time writes in a project; and clean-up after a killed run.

Every process that a writer starts has a variable in its environment, which its child processes
inherit. A process that acquires the lock first ends all processes with this variable: their writer
was killed.
"""

import fcntl
import json
import os
import re
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TextIO

from pacmo_core.data.limits import walk_files
from pacmo_core.project.processes import PROC, is_alive, kill_marked
from pacmo_core.project.records import utc_now
from pacmo_core.project.workspace import HISTORY, INBOX, PROMOTED_MODELS, CommandError
from pacmo_core.store.files import write_text

WRITER_VARIABLE = "PACMO_WRITER"
DVC_RWLOCK = Path(".dvc/tmp/rwlock")
# Folders in which runs write files by way of .NAME.PID (pacmo_core/store/files.py).
OUTPUT_FOLDERS = (
    *(Path("data"), Path("models"), Path("reports"), Path("checkpoints"), Path("live")),
    *(HISTORY, PROMOTED_MODELS),
)
_PARTIAL_NAME = re.compile(r"\..+\.(\d+)")
_PROBE_S = 0.5  # lock_holder of another process holds the lock for a moment
_KILL_TIMEOUT_S = 10.0


class BusyError(CommandError):
    """Another run writes in this project."""


@contextmanager
def writer_lock(job: str, path: Path) -> Iterator[None]:
    """Hold the project's lock while the block runs.

    The operating system releases the lock when its holder ends, however it ends. Processes
    that a killed holder has started may still write; they are killed before the block runs.

    Parameters
    ----------
    job : named in the error of the next run that is refused
    path : the file that is locked

    Raises
    ------
    BusyError
        If another run holds the lock, or the processes of a killed run do not end.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a+", encoding="utf-8") as file:
        _acquire(file)
        kill_orphans(path)
        file.truncate(0)
        file.write(json.dumps({"job": job, "pid": os.getpid(), "since": utc_now()}))
        file.flush()
        yield
        file.truncate(0)


def lock_holder(path: Path) -> str:
    """Return JSON with job, pid and start of the run that holds the lock; empty if none does."""
    if not path.exists():
        return ""
    with path.open("a+", encoding="utf-8") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return _content(file)
    return ""


def check_unlocked(path: Path) -> None:
    """Raise ``BusyError`` if another run holds the lock."""
    holder = lock_holder(path)
    if holder:
        raise BusyError(f"busy: {holder}")


def writer_environment(path: Path) -> dict[str, str]:
    """Return the environment variable that marks the processes of the writer that holds a lock."""
    return {WRITER_VARIABLE: str(path.resolve())}


def kill_orphans(path: Path) -> list[int]:
    """Kill the processes of writers that were killed; the caller holds the lock.

    Returns
    -------
    their process numbers; none where the system has no ``/proc``
    """
    pids, remaining = kill_marked(writer_environment(path), timeout_s=_KILL_TIMEOUT_S)
    if remaining:
        raise BusyError(f"processes {remaining} of a killed run do not end")
    return pids


def remove_partial_files() -> list[Path]:
    """Remove the files that killed processes had not finished writing; return their paths."""
    if not PROC.is_dir():
        return []
    partial = [
        path for folder in OUTPUT_FOLDERS for path in walk_files(folder) if _is_partial(path)
    ]
    for path in partial:
        path.unlink()
    return partial


def remove_dead_dvc_locks(path: Path = DVC_RWLOCK) -> list[int]:
    """Remove killed processes from DVC's list of readers and writers; the caller holds the lock.

    DVC itself ignores processes whose number is free. A killed process that its parent
    has not waited for (in a container without an init process, nobody does) keeps its number, and
    DVC would wait for it. An incomplete list is removed: DVC would refuse to start.

    Returns
    -------
    the numbers of the dead processes
    """
    if not path.exists() or not PROC.is_dir():
        return []
    try:
        entries: dict[str, dict[str, Any]] = json.loads(path.read_text(encoding="utf-8"))
    except ValueError:
        path.unlink()
        return []
    writers, readers = entries.get("write", {}), entries.get("read", {})
    processes = [*writers.values(), *(reader for group in readers.values() for reader in group)]
    dead = {entry["pid"] for entry in processes if entry and not is_alive(entry["pid"])}
    if dead:
        alive = {
            "write": {
                name: entry for name, entry in writers.items() if entry.get("pid") not in dead
            },
            "read": {
                name: [entry for entry in group if entry["pid"] not in dead]
                for name, group in readers.items()
            },
        }
        write_text(path, json.dumps(alive))
    return sorted(dead)


def _acquire(file: TextIO) -> None:
    deadline = time.monotonic() + _PROBE_S
    while True:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            if time.monotonic() > deadline:
                raise BusyError(f"busy: {_content(file)}") from error
            time.sleep(0.05)
        else:
            return


def _content(file: TextIO) -> str:
    file.seek(0)
    return file.read() or "a run that has just started"


def _is_partial(path: Path) -> bool:
    name = _PARTIAL_NAME.fullmatch(path.name)
    if name is None or path.is_relative_to(INBOX):  # nothing of this program writes there
        return False
    return path.is_file() and not is_alive(int(name[1]))
