"""Processes of a run: start them, find them, and end them on a signal.

Processes are found by a variable in their environment, as ``/proc`` or psutil shows it, rather than
by parent or process group: Prefect, DVC and the workers of stages start sessions of their own.
"""

import ctypes
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from pacmo_core.project.workspace import EXIT_INTERRUPTED

PROC = Path("/proc")
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)
_PR_SET_PDEATHSIG = 1  # prctl(2)
_TERMINATE_S = 1.0  # from SIGTERM to SIGKILL
_TIMEOUT_S = 8.0


def is_alive(pid: int) -> bool:
    """Return whether a process runs; a zombie, killed and not yet waited for, does not."""
    if not PROC.is_dir():
        return _is_alive_by_psutil(pid)
    try:
        status = (PROC / str(pid) / "stat").read_text()
    except OSError:
        return False
    # The state is the first field after the name, which is in brackets and may contain some.
    return status.rpartition(")")[2].split()[0] not in ("Z", "X")


def marked_processes(mark: Mapping[str, str]) -> list[int]:
    """List the living processes whose environment has all the variables of ``mark``."""
    if not PROC.is_dir():
        return _marked_by_psutil(mark)
    wanted = {f"{name}={value}".encode() for name, value in mark.items()}
    pids = []
    for folder in PROC.glob("[0-9]*"):
        with suppress(OSError):  # it ended, or is another user's
            variables = (folder / "environ").read_bytes().split(b"\0")
            if wanted <= set(variables):
                pids.append(int(folder.name))
    return pids


def _is_alive_by_psutil(pid: int) -> bool:
    import psutil  # noqa: PLC0415  # a second of imports where /proc tells the same

    with suppress(psutil.Error):
        return bool(psutil.Process(pid).status() != psutil.STATUS_ZOMBIE)
    return False


def _marked_by_psutil(mark: Mapping[str, str]) -> list[int]:
    import psutil  # noqa: PLC0415

    pids = []
    for process in psutil.process_iter():
        with suppress(psutil.Error):
            if mark.items() <= process.environ().items() and _is_alive_by_psutil(process.pid):
                pids.append(process.pid)
    return pids


def kill_marked(
    mark: Mapping[str, str], *, terminate_s: float = 0.0, timeout_s: float = _TIMEOUT_S
) -> tuple[list[int], list[int]]:
    """End the marked processes, and those that they start meanwhile, until none is alive.

    Parameters
    ----------
    mark : variables of their environment
    terminate_s : seconds from SIGTERM to SIGKILL; 0 for SIGKILL at once
    timeout_s : seconds after which it gives up

    Returns
    -------
    the numbers of all, and of those that are still alive
    """
    known: set[int] = set()
    start = time.monotonic()
    while pids := [pid for pid in marked_processes(mark) if pid != os.getpid()]:
        elapsed = time.monotonic() - start
        if elapsed > timeout_s:
            return sorted(known), pids
        for pid in pids:
            with suppress(ProcessLookupError):
                if elapsed >= terminate_s:
                    os.kill(pid, signal.SIGKILL)
                elif pid not in known:
                    os.kill(pid, signal.SIGTERM)
        known |= set(pids)
        time.sleep(0.02)
    return sorted(known), []


def start_process(
    command: Sequence[str], mark: Mapping[str, str], **options: Any
) -> "subprocess.Popen[bytes]":
    """Start a process with a mark, in its own session, that is killed with its parent.

    In its own session it does not get the terminal's Ctrl-C. Signals are blocked while it starts:
    a handler that runs in between would not see its mark yet.

    Parameters
    ----------
    command : program and arguments
    mark : variables of its environment, beside those of this process
    options : of ``subprocess.Popen``
    """
    environment = {**options.pop("env", os.environ), **mark}
    before = signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    try:
        return subprocess.Popen(
            command,
            env=environment,
            stdin=subprocess.DEVNULL,
            start_new_session=True,
            preexec_fn=_end_with_parent,
            **options,
        )
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _end_with_parent() -> None:
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    signal.pthread_sigmask(signal.SIG_SETMASK, [])


@contextmanager
def end_on_signal(clean_up: Callable[[], str]) -> Iterator[None]:
    """On SIGINT, SIGTERM or SIGHUP call ``clean_up``, print the line it returns, exit with 130.

    Further signals are ignored meanwhile. No ``finally`` of the block runs: nothing but
    ``clean_up`` may be needed to end it. After the block signals are ignored: the work is done, and
    a process that only has to exit would otherwise end as if it were not.
    """

    def end(_number: int, _frame: object) -> None:
        _ignore_signals()
        line = clean_up()
        # Not sys.stderr: the interrupted code may be writing to it.
        os.write(2, f"{line}\n".encode())
        os._exit(EXIT_INTERRUPTED)

    for number in SIGNALS:
        signal.signal(number, end)
    # ./run blocks them when it starts this process, so that none comes before the handlers are set.
    signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)
    try:
        yield
    finally:
        _ignore_signals()


def _ignore_signals() -> None:
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)


def end_run(mark: Mapping[str, str], command: str) -> str:
    """End all processes of a run; return a line that says so.

    Parameters
    ----------
    mark : variables of the environment of the processes
    command : that continues the run
    """
    pids, remaining = kill_marked(mark, terminate_s=_TERMINATE_S)
    if remaining:
        return f"interrupted: processes {remaining} do not end"
    count = f"{len(pids)} process{'es' if len(pids) != 1 else ''} ended"
    return f"interrupted: {count}; {command} continues where it stopped"
