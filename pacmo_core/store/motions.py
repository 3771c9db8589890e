"""Motions in Parquet: a row a frame, sorted by clip, eight clips a row group.

A single clip is located by the statistics of the row groups, and a file is streamed one row group
at a time, so that neither needs the whole file in memory. A folder of motions has a file for each
clip or for all variations of a clip, so that a new clip changes no existing file; Polars reads
such a folder as ``FOLDER/*.parquet``.
"""

import json
from bisect import bisect_left
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from urllib.parse import quote, unquote

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.names import sort_clips
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.store.files import StoreError, atomic_file
from pacmo_core.store.tables import VERSION, check_version, open_parquet

CLIPS_PER_ROW_GROUP = 8
POSES = ("person_a", "person_b")
SUFFIX = ".parquet"


def motion_schema(skeleton: Skeleton) -> pa.Schema:
    """Describe a row a frame: ``clip``, ``frame``, ``time`` (s), two ``(J, 3)`` poses (m).

    The skeleton and the version of the schema are in the metadata.
    """
    # Nested fixed-size lists, not the fixed_shape_tensor extension: Polars reads these as
    # Array(Float32, (J, 3)).
    pose = pa.list_(pa.list_(pa.float32(), 3), len(skeleton.joints))
    fields = [
        pa.field("clip", pa.string(), nullable=False),
        pa.field("frame", pa.int32(), nullable=False),
        pa.field("time", pa.float64(), nullable=False),
        pa.field("person_a", pose, nullable=False),
        pa.field("person_b", pose, nullable=False),
    ]
    metadata = {"pacmo": VERSION, "skeleton": json.dumps(skeleton.to_dict())}
    return pa.schema(fields, metadata=metadata)


def skeleton_of(schema: pa.Schema, path: Path) -> Skeleton:
    """Read the skeleton from the schema of a file.

    Raises
    ------
    StoreError
        If the version or the skeleton is missing or invalid.
    """
    check_version(schema, path)
    text = schema.metadata.get(b"skeleton")
    if text is None:
        raise StoreError(f"{path}: no skeleton in its metadata; it is not a file of motions")
    try:
        return Skeleton.from_dict(json.loads(text))
    except (KeyError, TypeError, ValueError) as error:
        raise StoreError(f"{path}: its metadata contain no valid skeleton ({error})") from error


class MotionWriter:
    """Appends clips to an open file, in ascending order of their names."""

    def __init__(self, file: pq.ParquetWriter, skeleton: Skeleton) -> None:
        self._file, self._skeleton = file, skeleton
        self._last = ""
        self._pending: list[pa.RecordBatch] = []

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
        self._pending.append(_to_rows(name, interaction, motion_schema(self._skeleton)))
        if len(self._pending) == CLIPS_PER_ROW_GROUP:
            self.flush()

    def flush(self) -> None:
        """Write the pending clips as one row group."""
        if self._pending:
            table = pa.Table.from_batches(self._pending).combine_chunks()
            self._file.write_table(table, row_group_size=len(table))
            self._pending = []


@contextmanager
def write_motions(path: Path, skeleton: Skeleton) -> Iterator[MotionWriter]:
    """Open a file for writing; it appears under its name when the block succeeds."""
    with (
        atomic_file(path) as partial,
        pq.ParquetWriter(
            partial,
            motion_schema(skeleton),
            compression="zstd",
            compression_level=3,
            use_dictionary=["clip"],
            # Bytes of equal significance are stored together and compress better: half the size.
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
        yield from _clips_of(file.read_row_group(group), skeleton)


def read_motion(path: Path, name: str) -> Interaction:
    """Read one clip from the row groups that can contain it.

    Raises
    ------
    KeyError
        If the file contains no such clip.
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
    """Read the skeleton of a file of motions."""
    return skeleton_of(open_parquet(path).schema_arrow, path)


class MotionReader:
    """Reads many clips of one file by name; the last row groups stay in memory.

    ``read_motion`` opens the file and reads a row group for every clip. Clips that are read in
    their order come from a row group already in memory, seven times of eight.

    Raises
    ------
    StoreError
        If the file is not one of this store.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._file = path, open_parquet(path)
        self._skeleton = skeleton_of(self._file.schema_arrow, path)
        metadata = self._file.metadata
        columns = (metadata.row_group(group).column(0) for group in range(metadata.num_row_groups))
        self._last_names = [column.statistics.max for column in columns]
        self._group = lru_cache(maxsize=2)(self._read_group)

    def read(self, name: str) -> Interaction:
        """Read one clip.

        Raises
        ------
        KeyError
            If the file contains no such clip.
        """
        group = bisect_left(self._last_names, name)
        clips = self._group(group) if group < len(self._last_names) else {}
        if name not in clips:
            raise KeyError(f"{self._path}: no clip {name}")
        return clips[name]

    def _read_group(self, group: int) -> dict[str, Interaction]:
        return dict(_clips_of(self._file.read_row_group(group), self._skeleton))


def motion_file(folder: Path, clip: str) -> Path:
    """Return the file of a clip in a folder of motions; ``/`` in a name is quoted."""
    return folder / f"{quote(clip, safe='#')}{SUFFIX}"


def clip_of_file(file: Path) -> str:
    """Return the clip of a file in a folder of motions."""
    return unquote(file.name.removesuffix(SUFFIX))


def stream_folder(folder: Path) -> Iterator[tuple[str, Interaction]]:
    """Yield all motions of a folder of variations in ascending order of their names.

    Raises
    ------
    FileNotFoundError
        If there is no such folder.
    StoreError
        If a file is not one of this store.
    """
    if not folder.is_dir():
        raise FileNotFoundError(f"{folder}: no folder of motions")
    for clip in sort_clips(clip_of_file(file) for file in folder.glob(f"*{SUFFIX}")):
        yield from stream_motions(motion_file(folder, clip))


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


def _clips_of(table: pa.Table, skeleton: Skeleton) -> Iterator[tuple[str, Interaction]]:
    """Yield the clips of a row group."""
    names = table["clip"].to_numpy()
    edges = [0, *(np.flatnonzero(names[1:] != names[:-1]) + 1).tolist(), len(names)]
    for start, stop in pairwise(edges):
        yield str(names[start]), _from_rows(table.slice(start, stop - start), skeleton)


def _from_rows(table: pa.Table, skeleton: Skeleton) -> Interaction:
    person_a, person_b = (
        # flatten() honours the slice; the values reach NumPy without a copy.
        table[pose].combine_chunks().flatten().flatten().to_numpy().reshape(len(table), -1, 3)
        for pose in POSES
    )
    return Interaction(skeleton, table["time"].to_numpy(), person_a, person_b)
