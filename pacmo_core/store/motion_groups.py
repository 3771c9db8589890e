"""Read many clips of one file, near each other in it, one after the other."""

from bisect import bisect_left
from functools import lru_cache
from itertools import pairwise
from pathlib import Path

import numpy as np

from pacmo_core.data.interaction import Interaction

# From beside, as every network would be trained again after an edit of that module.
from pacmo_core.store.motions import _from_rows
from pacmo_core.store.schema import open_parquet, skeleton_of


class MotionGroups:
    """An open file of motions, whose last row groups stay in memory.

    ``read_motion`` opens the file and reads a row group for every clip; of a thousand that are
    read in their order, all but one in eight stand in the group that was read for the one before.

    Raises
    ------
    StoreError
        If the file is not one of this store.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._file = path, open_parquet(path)
        self._skeleton = skeleton_of(self._file.schema_arrow, path)
        facts = self._file.metadata
        columns = (facts.row_group(group).column(0) for group in range(facts.num_row_groups))
        self._last = [column.statistics.max for column in columns]
        self._group = lru_cache(maxsize=2)(self._read_group)

    def read(self, name: str) -> Interaction:
        """Read one clip.

        Raises
        ------
        KeyError
            If the file holds no such clip.
        """
        group = bisect_left(self._last, name)
        found = self._group(group) if group < len(self._last) else {}
        if name not in found:
            raise KeyError(f"{self._path}: no clip {name}")
        return found[name]

    def _read_group(self, group: int) -> dict[str, Interaction]:
        table = self._file.read_row_group(group)
        names = table["clip"].to_numpy()
        edges = [0, *(np.flatnonzero(names[1:] != names[:-1]) + 1).tolist(), len(names)]
        return {
            str(names[start]): _from_rows(table.slice(start, stop - start), self._skeleton)
            for start, stop in pairwise(edges)
        }
