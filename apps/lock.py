"""One writer at a time, with or without a server, and no writer left over from a killed run."""

import fcntl
import json
import os
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import TextIO

from apps.failure import CommandError

# What a writer starts to write bears this in its environment, and so does all that those start.
MARK = "PACMO_WRITER"
PROC = Path("/proc")
_GLANCE = 0.5  # seconds; who only asks whether it is held, holds it for an instant
_PATIENCE = 10.0  # seconds for a killed process to be gone


class BusyError(CommandError):
    """Another run writes in this project now."""


@contextmanager
def one_writer(job: str, path: Path) -> Iterator[None]:
    """Hold the project's lock while the block runs.

    The system lets go of the lock when its holder dies, however it dies. What a killed holder
    had started may live on and still write: it is ended before the block begins.

    Parameters
    ----------
    job : what the next one who is refused is told
    path : the file that is locked

    Raises
    ------
    BusyError
        If another run holds it, with who and since when.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a+", encoding="utf-8") as file:
        _take(file)
        end_orphans(path)
        file.truncate(0)
        since = datetime.now(UTC).isoformat(timespec="seconds")
        file.write(json.dumps({"job": job, "pid": os.getpid(), "since": since}))
        file.flush()
        yield
        file.truncate(0)


def _take(file: TextIO) -> None:
    deadline = time.monotonic() + _GLANCE
    while True:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as held:
            if time.monotonic() > deadline:
                file.seek(0)
                raise BusyError(f"busy: {file.read() or 'a run that has just begun'}") from held
            time.sleep(0.05)
        else:
            return


def is_held(path: Path) -> str:
    """Say who holds the lock; empty if nobody does."""
    if not path.exists():
        return ""
    with path.open("a+", encoding="utf-8") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            file.seek(0)
            return file.read() or "a run that has just begun"
    return ""


def mark_of(path: Path) -> dict[str, str]:
    """Give the environment by which a process of a writer is known."""
    return {MARK: str(path.resolve())}


def end_orphans(path: Path) -> list[int]:
    """Kill the processes that writers of this workspace left behind.

    The caller holds the lock and has not begun, so whoever bears its mark has lost its writer.
    Where the system has no ``/proc``, none are found.

    Returns
    -------
    their process numbers
    """
    found = _marked(path)
    for pid in found:
        try:
            os.kill(pid, signal.SIGKILL)
        except ProcessLookupError:
            continue  # gone by itself meanwhile
    deadline = time.monotonic() + _PATIENCE
    while set(_marked(path)) & set(found):
        if time.monotonic() > deadline:
            raise BusyError(f"processes {found} of a killed run do not end")
        time.sleep(0.02)
    return found


def lives(pid: int) -> bool:
    """Tell whether a process lives; one that was killed and not yet waited for does not."""
    status = PROC / str(pid) / "stat"
    # The state is the first word after the name, which stands in brackets and may hold some.
    return status.exists() and status.read_text().rpartition(")")[2].split()[0] not in ("Z", "X")


def _marked(path: Path) -> list[int]:
    needle = f"{MARK}={path.resolve()}".encode()
    found = []
    for folder in PROC.glob("[0-9]*"):
        try:
            words = (folder / "environ").read_bytes().split(b"\0")
        except OSError:
            continue  # gone meanwhile, or another user's
        if needle in words:
            found.append(int(folder.name))
    return found
