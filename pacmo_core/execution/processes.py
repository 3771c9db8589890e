"""Work in processes of this machine, as ``cluster`` has it done on others.

Not by ``ProcessPoolExecutor``: its processes answer through one pipe, and where one is killed in
the middle of an answer, as by a machine short of memory, it waits for the rest of it without end.
Here each has a pipe of its own, which ends with it.
"""

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
from typing import Any, Self, TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")

SPAWN = get_context("spawn")
# Items handed out a process: what is done and not yet taken stands in memory.
AHEAD = 2


class Processes:
    """Processes side by side; they die with this one, however that ends.

    Parameters
    ----------
    count : of processes
    """

    def __init__(self, count: int) -> None:
        self._ahead = AHEAD * count
        self._processes = [_Process() for _ in range(count)]
        self._idle = SimpleQueue[_Process]()
        for process in self._processes:
            self._idle.put(process)
        # One a process, to wait for it.
        self._threads = ThreadPoolExecutor(count)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._threads.shutdown(wait=False, cancel_futures=True)
        for process in self._processes:
            process.end()
        self._threads.shutdown()

    def as_done(self, do: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
        """Yield results as they come, in no order.

        Raises
        ------
        ChildProcessError
            If a process ends before it has answered.
        """
        waiting = iter(items)
        running = {self._begin(do, item) for item in islice(waiting, self._ahead)}
        while running:
            done, running = wait(running, return_when=FIRST_COMPLETED)
            running |= {self._begin(do, item) for item in islice(waiting, len(done))}
            for ended in done:
                yield ended.result()

    def in_order(self, do: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
        """Yield results in the order of the items.

        Raises
        ------
        ChildProcessError
            If a process ends before it has answered.
        """
        waiting = iter(items)
        running = deque(self._begin(do, item) for item in islice(waiting, self._ahead))
        while running:
            result = running.popleft().result()
            running.extend(self._begin(do, item) for item in islice(waiting, 1))
            yield result

    def _begin(self, do: Callable[[Item], Result], item: Item) -> Future[Result]:
        return self._threads.submit(self._ask, do, item)

    def _ask(self, do: Callable[[Item], Result], item: Item) -> Result:
        process = self._idle.get()
        try:
            result: Result = process.ask(do, item)
            return result
        finally:
            self._idle.put(process)


class _Process:
    """One process and the pipe to it."""

    def __init__(self) -> None:
        self._pipe, theirs = SPAWN.Pipe()
        self._process = SPAWN.Process(target=_answer, args=(theirs,), daemon=True)
        self._process.start()
        theirs.close()  # or the pipe would outlive the process

    def ask(self, do: Callable[[Item], Result], item: Item) -> Any:
        """Have something done, and wait for it."""
        try:
            self._pipe.send((do, item))
            result, fault = self._pipe.recv()
        except (EOFError, OSError) as ended:
            self._process.join()
            code = self._process.exitcode
            raise ChildProcessError(
                f"a process that worked for this one ended before its answer, exit code {code}"
            ) from ended
        if fault:
            raise fault
        return result

    def end(self) -> None:
        """End the process, whatever it is doing."""
        self._process.kill()
        self._process.join()


def _answer(pipe: Connection) -> None:
    """Do what is asked until this process is ended."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent's to answer
    threading.Thread(target=_follow_parent, daemon=True).start()
    while True:
        do, item = pipe.recv()
        answer: tuple[Any, Exception | None]
        try:
            answer = do(item), None
        except Exception as fault:  # noqa: BLE001  # raised again by whom it concerns
            fault.add_note(f"As raised in a process of its own:\n{format_exc()}")
            answer = None, fault
        pipe.send(answer)


def _follow_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
