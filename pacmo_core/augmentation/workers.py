"""Lots side by side: over this machine's processes, or over a cluster's.

Outcomes come as they are done, in no order; nothing rests on which process made what.
"""

from collections.abc import Iterator, Sequence

from pacmo_core.augmentation.solve import Lot, Outcome, solve
from pacmo_core.execution import DaskExecutor, ProcessExecutor


def solve_side_by_side(lots: Sequence[Lot], *, processes: int) -> Iterator[Outcome]:
    """Solve lots on as many processes, at most one a lot; where one will do, it is this one."""
    count = min(processes, len(lots))
    if count <= 1:
        yield from map(solve, longest_first(lots))
        return
    with ProcessExecutor(count) as workers:
        yield from workers.map_unordered(solve, longest_first(lots))


def solve_on_cluster(lots: Sequence[Lot], address: str) -> Iterator[Outcome]:
    """Solve lots on the workers of a Dask scheduler, which need this package.

    Raises
    ------
    ModuleNotFoundError
        If ``distributed`` is not installed: it is the extra ``dask``.
    """
    with DaskExecutor(address) as cluster:
        yield from cluster.map_unordered(solve, longest_first(lots))


def longest_first(lots: Sequence[Lot]) -> list[Lot]:
    """Order lots so that all workers end at about the same time: what is begun last is short."""
    return sorted(lots, key=lambda lot: -len(lot.source.times) * len(lot.scales))
