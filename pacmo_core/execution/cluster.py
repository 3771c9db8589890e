"""Work on the machines of a Dask cluster, by its scheduler's address alone.

Nothing rests on which worker does what, nor on how many there are. What a worker that dies had in
hand is done again by another.
"""

import importlib
from collections.abc import Callable, Iterable, Iterator
from typing import Any, Self, TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


class Cluster:
    """The workers of a scheduler, which need this package.

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

    def as_done(self, do: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
        """Yield results as they come, in no order."""
        for done in self._dask.as_completed(self._running(do, items)):
            yield done.result()
            done.release()

    def in_order(self, do: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
        """Yield results in the order of the items."""
        for running in self._running(do, items):
            yield running.result()
            running.release()

    def _running(self, do: Callable[[Item], Result], items: Iterable[Item]) -> list[Any]:
        # Not by content: Dask would take equal arguments for a result that it may have lost.
        running: list[Any] = self._client.map(do, list(items), pure=False)
        return running
