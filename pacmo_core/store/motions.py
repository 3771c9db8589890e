"""Motions in Parquet: a row a frame, sorted by clip, eight clips a row group.

A single clip is located by the statistics of the row groups, and a file is streamed one row group
at a time, so that neither needs the whole file in memory. In files of other programs a clip may
continue in further row groups, and statistics may be missing: the names are read then.

A folder of motions has a file for each clip or for all variations of a clip, so that a new clip
changes no existing file; Polars reads such a folder as ``FOLDER/*.parquet``.
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
import pyarrow.parquet as pq
from numpy.typing import NDArray

from pacmo_core.data.interaction import Interaction, Motion
from pacmo_core.data.limits import MAX_COORDINATE_M, MAX_GAP, MAX_POSITIONS, MIN_GAP
from pacmo_core.data.names import sort_clips
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.store.files import StoreError, atomic_file
from pacmo_core.store.parquet import (
    VERSION,
    check_columns,
    check_values,
    check_version,
    open_parquet,
    parquet_errors,
)

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
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        raise StoreError(f"{path}: its metadata contain no valid skeleton ({error})") from error


class MotionWriter:
    """Appends clips to an open file, in ascending order of their names."""

    def __init__(self, file: pq.ParquetWriter, skeleton: Skeleton) -> None:
        self._file, self._skeleton = file, skeleton
        self._last = ""
        self._pending: list[pa.RecordBatch] = []
        self._n_pending = 0

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
        positions = len(interaction.times) * len(self._skeleton.joints)
        if self._n_pending + positions > MAX_POSITIONS:
            self.flush()  # a reader has a whole row group in memory
        self._last = name
        self._pending.append(_to_rows(name, interaction, motion_schema(self._skeleton)))
        self._n_pending += positions
        if len(self._pending) == CLIPS_PER_ROW_GROUP:
            self.flush()

    def flush(self) -> None:
        """Write the pending clips as one row group."""
        if self._pending:
            table = pa.Table.from_batches(self._pending).combine_chunks()
            self._file.write_table(table, row_group_size=len(table))
            self._pending, self._n_pending = [], 0


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
    file = _MotionFile(path)
    name, parts = "", list[pa.Table]()
    for group in range(file.n_groups):
        for next_name, rows in file.read_clips(group).items():
            if parts and next_name != name:
                yield name, file.make_interaction(name, parts)
                parts = []
            name = file.check_order(name, next_name)
            parts.append(rows)
    if parts:
        yield name, file.make_interaction(name, parts)


def read_motion(path: Path, name: str) -> Interaction:
    """Read one clip from the row groups that can contain it.

    Raises
    ------
    KeyError
        If the file contains no such clip.
    StoreError
        If the file is not one of this store.
    """
    return MotionReader(path).read(name)


def read_names(path: Path) -> list[str]:
    """Read the names of all clips of a file, in order, without their motions.

    Raises
    ------
    StoreError
        If the file is not one of this store.
    """
    file = open_parquet(path)
    skeleton_of(file.schema_arrow, path)
    with parquet_errors(path):
        names = file.read(columns=["clip"])
    check_values(names, ["clip"], path)
    return [str(name) for name in names["clip"].unique().to_pylist()]


def read_skeleton(path: Path) -> Skeleton:
    """Read the skeleton of a file of motions."""
    return skeleton_of(open_parquet(path).schema_arrow, path)


class MotionReader:
    """Reads clips of one file by name; the last row groups stay in memory.

    Clips that are read in their order come from a row group already in memory, seven times of
    eight.

    Raises
    ------
    StoreError
        If the file is not one of this store.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._file = path, _MotionFile(path)
        limits = [self._file.first_and_last(group) for group in range(self._file.n_groups)]
        # Groups without rows hold no clip.
        self._groups = [group for group, names in enumerate(limits) if names is not None]
        known = [names for names in limits if names is not None]
        self._first_names = [first for first, _ in known]
        self._last_names = [last for _, last in known]
        for earlier, later in zip(self._last_names, self._first_names[1:], strict=False):
            self._file.check_order(earlier, later)
        self._group = lru_cache(maxsize=2)(self._file.read_clips)

    def read(self, name: str) -> Interaction:
        """Read one clip.

        Raises
        ------
        KeyError
            If the file contains no such clip.
        StoreError
            If its rows are damaged.
        """
        parts = []
        for index in range(bisect_left(self._last_names, name), len(self._groups)):
            if self._first_names[index] > name:
                break
            clips = self._group(self._groups[index])
            parts += [clips[name]] if name in clips else []
        if not parts:
            raise KeyError(f"{self._path}: no clip {name}")
        return self._file.make_interaction(name, parts)


class _MotionFile:
    """An open file of motions whose schema is checked."""

    def __init__(self, path: Path) -> None:
        self._path, self._file = path, open_parquet(path)
        schema = self._file.schema_arrow
        self._skeleton = skeleton_of(schema, path)
        check_columns(schema, list(motion_schema(self._skeleton)), path)
        with parquet_errors(path):
            leaves = [self._file.schema.column(i).path for i in range(len(self._file.schema))]
        self._clip_column = leaves.index("clip")

    @property
    def n_groups(self) -> int:
        """Number of row groups."""
        return int(self._file.num_row_groups)

    def first_and_last(self, group: int) -> tuple[str, str] | None:
        """Return the first and the last clip of a row group by its statistics, or by its rows."""
        if not self._file.metadata.row_group(group).num_rows:
            return None
        with parquet_errors(self._path):
            statistics = self._file.metadata.row_group(group).column(self._clip_column).statistics
            if statistics is not None and isinstance(statistics.min, str):
                return statistics.min, statistics.max
            names = self._file.read_row_group(group, columns=["clip"])["clip"]
        check_values(pa.table({"clip": names}), ["clip"], self._path)
        return str(names[0]), str(names[-1])

    def read_clips(self, group: int) -> dict[str, pa.Table]:
        """Read the rows of a row group by clip, in their order."""
        self._check_rows(self._file.metadata.row_group(group).num_rows, f"row group {group}")
        with parquet_errors(self._path):
            table = self._file.read_row_group(group)
        check_values(table, table.column_names, self._path)
        names = table["clip"].to_numpy()
        edges = [0, *(np.flatnonzero(names[1:] != names[:-1]) + 1).tolist(), len(names)]
        clips: dict[str, pa.Table] = {}
        for start, stop in pairwise(edges if len(names) else []):
            self.check_order(next(reversed(clips), ""), str(names[start]))
            clips[str(names[start])] = table.slice(start, stop - start)
        return clips

    def check_order(self, earlier: str, later: str) -> str:
        """Return the later of two names; refuse a file whose clips do not ascend or have none."""
        if not later:
            raise StoreError(f"{self._path}: a clip has no name")
        if later < earlier:
            raise StoreError(
                f"{self._path}: clips must be in ascending order; got {later} after {earlier}"
            )
        return later

    def make_interaction(self, name: str, parts: list[pa.Table]) -> Interaction:
        """Join the rows of one clip."""
        self._check_rows(sum(map(len, parts)), f"clip {name}")
        table = parts[0] if len(parts) == 1 else pa.concat_tables(parts)
        frames, times = table["frame"].to_numpy(), table["time"].to_numpy()
        if not np.array_equal(frames, np.arange(len(frames))):
            raise StoreError(f"{self._path}: clip {name}: wanted frames 0, 1, ... in order")
        try:
            _check_times(times)
            people = [_to_motion(table[pose]) for pose in POSES]
            _check_positions(people)
            return Interaction(self._skeleton, times, *people)
        except ValueError as error:
            raise StoreError(f"{self._path}: clip {name}: {error}") from error

    def _check_rows(self, n_rows: int, what: str) -> None:
        most = 2 * MAX_POSITIONS // len(self._skeleton.joints)
        if n_rows > most:
            raise StoreError(f"{self._path}: {what}: wanted at most {most} frames; got {n_rows}")


def _check_times(times: NDArray[np.float64]) -> None:
    gaps = np.diff(times)
    wrong = np.flatnonzero(~((gaps >= MIN_GAP) & (gaps <= MAX_GAP)))
    if len(wrong):
        reason = f"frame {wrong[0] + 1} is {gaps[wrong[0]]:g} s after the one before it"
        raise ValueError(f"{reason}; wanted {MIN_GAP:g} to {MAX_GAP:g} s")


def _check_positions(people: list[Motion]) -> None:
    for person, motion in zip(POSES, people, strict=True):
        far = float(np.abs(motion).max(initial=0.0))
        if far > MAX_COORDINATE_M:
            raise ValueError(f"{person} is {far:g} m away; wanted at most {MAX_COORDINATE_M:g} m")


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


def _to_motion(column: pa.ChunkedArray) -> NDArray[np.float32]:
    # flatten() honours the slice; the values reach NumPy without a copy.
    values: NDArray[np.float32] = column.combine_chunks().flatten().flatten().to_numpy()
    return values.reshape(len(column), -1, 3)
