"""Parallel execution: one interface for processes of this machine and for a Dask cluster.

``open_executor`` gives an executor by the address of a Dask scheduler, or one of this machine's
processes. Results do not depend on which worker computes what, nor on the number of workers.
"""

import importlib
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from itertools import islice
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection
from queue import SimpleQueue
from traceback import format_exc
from typing import Any, Protocol, Self, TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")

SPAWN = get_context("spawn")
# Submitted items per process: results that are computed and not yet consumed stay in memory.
ITEMS_PER_PROCESS = 2


class Executor(Protocol):
    """Workers that apply a function to items in parallel."""

    def __enter__(self) -> Self:
        """Return the executor."""

    def __exit__(self, *_: object) -> None:
        """Stop the workers."""

    def map_ordered(
        self, function: Callable[[Item], Result], items: Iterable[Item]
    ) -> Iterator[Result]:
        """Yield the results in the order of the items."""

    def map_unordered(
        self, function: Callable[[Item], Result], items: Iterable[Item]
    ) -> Iterator[Result]:
        """Yield each result as soon as it is computed."""


def open_executor(address: str, *, n_processes: int | None = None) -> Executor:
    """Connect to the Dask scheduler at ``address``, or start processes if it is empty.

    Parameters
    ----------
    address : of the scheduler, ``tcp://host:8786``
    n_processes : on this machine; by default one a core
    """
    if address:
        return DaskExecutor(address)
    return ProcessExecutor(n_processes or os.cpu_count() or 1)


# Neither concurrent.futures nor loky: the workers of both return results through one shared pipe,
# so that a worker killed while it writes (out of memory) leaves the caller waiting for ever.
class ProcessExecutor:
    """Processes of this machine, each with its own pipe; they end with the parent process.

    Parameters
    ----------
    n_processes : number of processes
    """

    def __init__(self, n_processes: int) -> None:
        self._n_submitted = ITEMS_PER_PROCESS * n_processes
        self._processes = [_Process() for _ in range(n_processes)]
        self._idle = SimpleQueue[_Process]()
        for process in self._processes:
            self._idle.put(process)
        # One thread a process, which waits for its result.
        self._threads = ThreadPoolExecutor(n_processes)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._threads.shutdown(wait=False, cancel_futures=True)
        for process in self._processes:
            process.kill()
        self._threads.shutdown()

    def map_unordered(
        self, function: Callable[[Item], Result], items: Iterable[Item]
    ) -> Iterator[Result]:
        """Yield each result as soon as it is computed.

        Raises
        ------
        ChildProcessError
            If a process ends before it returns its result.
        """
        remaining = iter(items)
        running = {self._submit(function, item) for item in islice(remaining, self._n_submitted)}
        while running:
            done, running = wait(running, return_when=FIRST_COMPLETED)
            running |= {self._submit(function, item) for item in islice(remaining, len(done))}
            for future in done:
                yield future.result()

    def map_ordered(
        self, function: Callable[[Item], Result], items: Iterable[Item]
    ) -> Iterator[Result]:
        """Yield the results in the order of the items.

        Raises
        ------
        ChildProcessError
            If a process ends before it returns its result.
        """
        remaining = iter(items)
        running = deque(
            self._submit(function, item) for item in islice(remaining, self._n_submitted)
        )
        while running:
            result = running.popleft().result()
            running.extend(self._submit(function, item) for item in islice(remaining, 1))
            yield result

    def _submit(self, function: Callable[[Item], Result], item: Item) -> Future[Result]:
        return self._threads.submit(self._run, function, item)

    def _run(self, function: Callable[[Item], Result], item: Item) -> Result:
        process = self._idle.get()
        try:
            result: Result = process.run(function, item)
            return result
        finally:
            self._idle.put(process)


class _Process:
    """One process and the pipe to it."""

    def __init__(self) -> None:
        self._pipe, worker_end = SPAWN.Pipe()
        self._process = SPAWN.Process(target=_worker_loop, args=(worker_end,), daemon=True)
        self._process.start()
        worker_end.close()  # or the pipe would stay open when the process ends

    def run(self, function: Callable[[Item], Result], item: Item) -> Any:
        """Run a function in the process and wait for its result."""
        try:
            self._pipe.send((function, item))
            result, error = self._pipe.recv()
        except (EOFError, OSError) as closed:
            self._process.join()
            raise ChildProcessError(
                "a worker process ended before it returned its result, "
                f"exit code {self._process.exitcode}"
            ) from closed
        if error:
            raise error
        return result

    def kill(self) -> None:
        """End the process, whatever it is doing."""
        self._process.kill()
        self._process.join()


def _worker_loop(pipe: Connection) -> None:
    """Run functions until this process is killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is handled by the parent process
    threading.Thread(target=_exit_with_parent, daemon=True).start()
    while True:
        function, item = pipe.recv()
        message: tuple[Any, Exception | None]
        try:
            message = function(item), None
        except Exception as error:  # noqa: BLE001  # raised again in the parent process
            error.add_note(f"Raised in a worker process:\n{format_exc()}")
            message = None, error
        pipe.send(message)


def _exit_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


class DaskExecutor:
    """The workers of a Dask scheduler, on which this package must be installed.

    Work of a worker that dies is computed again by another one.

    Parameters
    ----------
    address : of the scheduler, ``tcp://host:8786``

    Raises
    ------
    ModuleNotFoundError
        If ``distributed`` is not installed: it is the extra ``dask``.
    """

    def __init__(self, address: str) -> None:
        self._dask: Any = importlib.import_module("distributed")
        self._client: Any = self._dask.Client(address)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._client.close()

    def map_unordered(
        self, function: Callable[[Item], Result], items: Iterable[Item]
    ) -> Iterator[Result]:
        """Yield each result as soon as it is computed."""
        for future in self._dask.as_completed(self._submit(function, items)):
            yield future.result()
            future.release()

    def map_ordered(
        self, function: Callable[[Item], Result], items: Iterable[Item]
    ) -> Iterator[Result]:
        """Yield the results in the order of the items."""
        for future in self._submit(function, items):
            yield future.result()
            future.release()

    def _submit(self, function: Callable[[Item], Result], items: Iterable[Item]) -> list[Any]:
        # pure=False: Dask would otherwise treat equal arguments as one result, which may be lost.
        futures: list[Any] = self._client.map(function, list(items), pure=False)
        return futures
