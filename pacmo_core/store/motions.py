"""Motions in Parquet: a row a frame, sorted by clip, a few clips a row group.

A clip is found by the row groups' statistics and read alone, and a file streams a row group at a
time, so that neither needs the file in memory.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.store.atomic import whole_file
from pacmo_core.store.schema import motion_schema, open_parquet, skeleton_of

CLIPS_PER_ROW_GROUP = 8
POSES = ("person_a", "person_b")


class MotionWriter:
    """Adds clips to an open file, in ascending order of their names."""

    def __init__(self, file: pq.ParquetWriter, skeleton: Skeleton) -> None:
        self._file, self._skeleton = file, skeleton
        self._last = ""
        self._waiting: list[pa.RecordBatch] = []

    def add(self, name: str, interaction: Interaction) -> None:
        """Append one clip.

        Raises
        ------
        ValueError
            If names do not ascend, or the clip's skeleton is not the file's.
        """
        if name <= self._last:
            raise ValueError(f"clips must come in ascending order; got {name} after {self._last}")
        if interaction.skeleton != self._skeleton:
            raise ValueError(
                f"clip {name}: wanted skeleton {self._skeleton.name} "
                f"({len(self._skeleton.joints)} joints), got {interaction.skeleton.name} "
                f"({len(interaction.skeleton.joints)} joints)"
            )
        self._last = name
        self._waiting.append(_to_rows(name, interaction, motion_schema(self._skeleton)))
        if len(self._waiting) == CLIPS_PER_ROW_GROUP:
            self.flush()

    def flush(self) -> None:
        """Write the clips that wait as one row group."""
        if self._waiting:
            table = pa.Table.from_batches(self._waiting).combine_chunks()
            self._file.write_table(table, row_group_size=len(table))
            self._waiting = []


@contextmanager
def write_motions(path: Path, skeleton: Skeleton) -> Iterator[MotionWriter]:
    """Open a file for writing; it appears under its name when the block ends well."""
    with (
        whole_file(path) as partial,
        pq.ParquetWriter(
            partial,
            motion_schema(skeleton),
            compression="zstd",
            compression_level=3,
            use_dictionary=["clip"],
            # Bytes of like weight lie together and compress: half the size of the default.
            use_byte_stream_split=[
                "time",
                *(f"{pose}.list.element.list.element" for pose in POSES),
            ],
        ) as file,
    ):
        writer = MotionWriter(file, skeleton)
        yield writer
        writer.flush()


def stream_motions(path: Path) -> Iterator[tuple[str, Interaction]]:
    """Yield every clip in order, one row group in memory at a time.

    Raises
    ------
    StoreError
        If the file is not one of this store.
    """
    file = open_parquet(path)
    skeleton = skeleton_of(file.schema_arrow, path)
    for group in range(file.num_row_groups):
        table = file.read_row_group(group)
        names = table["clip"].to_numpy()
        edges = [0, *(np.flatnonzero(names[1:] != names[:-1]) + 1).tolist(), len(names)]
        for start, stop in pairwise(edges):
            yield str(names[start]), _from_rows(table.slice(start, stop - start), skeleton)


def read_motion(path: Path, name: str) -> Interaction:
    """Read one clip by the row groups that can hold it.

    Raises
    ------
    KeyError
        If the file holds no such clip.
    StoreError
        If the file is not one of this store.
    """
    file = open_parquet(path)
    skeleton = skeleton_of(file.schema_arrow, path)
    for group in range(file.num_row_groups):
        limits = file.metadata.row_group(group).column(0).statistics
        if limits.min <= name <= limits.max:
            table = file.read_row_group(group)
            table = table.filter(pc.equal(table["clip"], name))
            if len(table):
                return _from_rows(table, skeleton)
    raise KeyError(f"{path}: no clip {name}")


def read_skeleton(path: Path) -> Skeleton:
    """Read the skeleton that a file of motions is of."""
    return skeleton_of(open_parquet(path).schema_arrow, path)


def _to_rows(name: str, interaction: Interaction, schema: pa.Schema) -> pa.RecordBatch:
    n_frames = len(interaction.times)
    columns = [
        pa.repeat(name, n_frames),
        pa.array(np.arange(n_frames, dtype=np.int32)),
        pa.array(interaction.times),
        *(_to_poses(getattr(interaction, pose)) for pose in POSES),
    ]
    return pa.RecordBatch.from_arrays(columns, schema=schema)


def _to_poses(motion: NDArray[np.float32]) -> pa.FixedSizeListArray:
    points = pa.FixedSizeListArray.from_arrays(np.ascontiguousarray(motion).reshape(-1), 3)
    return pa.FixedSizeListArray.from_arrays(points, motion.shape[1])


def _from_rows(table: pa.Table, skeleton: Skeleton) -> Interaction:
    person_a, person_b = (
        # flatten() honours the slice; the values reach NumPy without a copy.
        table[pose].combine_chunks().flatten().flatten().to_numpy().reshape(len(table), -1, 3)
        for pose in POSES
    )
    return Interaction(skeleton, table["time"].to_numpy(), person_a, person_b)
