"""Lots side by side: over this machine's processes, or over a cluster's.

Outcomes come as they are done, in no order; nothing rests on which process made what.
"""

import os
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from itertools import islice
from multiprocessing import get_context, parent_process

from pacmo_core.cluster import Cluster
from pacmo_core.variations.solve import Lot, Outcome, solve


def solve_side_by_side(lots: Sequence[Lot], *, processes: int) -> Iterator[Outcome]:
    """Solve lots on as many processes, at most one a lot; where one will do, it is this one.

    They die with this one: a killed run leaves nothing behind that goes on.
    """
    count, waiting = min(processes, len(lots)), iter(longest_first(lots))
    if count <= 1:
        yield from map(solve, waiting)
        return
    with ProcessPoolExecutor(count, get_context("spawn"), initializer=die_with_parent) as pool:
        # Few are handed out at a time: what is done and not yet taken stands in memory.
        running = {pool.submit(solve, lot) for lot in islice(waiting, 2 * count)}
        while running:
            done, running = wait(running, return_when=FIRST_COMPLETED)
            running |= {pool.submit(solve, lot) for lot in islice(waiting, len(done))}
            for future in done:
                yield future.result()


def solve_on_cluster(lots: Sequence[Lot], address: str) -> Iterator[Outcome]:
    """Solve lots on the workers of a Dask scheduler, which need this package.

    Raises
    ------
    ModuleNotFoundError
        If ``distributed`` is not installed: it is the extra ``dask``.
    """
    with Cluster(address) as cluster:
        yield from cluster.as_done(solve, longest_first(lots))


def longest_first(lots: Sequence[Lot]) -> list[Lot]:
    """Order lots so that all workers end at about the same time: what is begun last is short."""
    return sorted(lots, key=lambda lot: -len(lot.source.times) * len(lot.scales))


def die_with_parent() -> None:
    """End this process when the one that started it ends, however that comes about."""
    parent = parent_process()
    if parent is None:
        return

    def follow() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=follow, daemon=True).start()
