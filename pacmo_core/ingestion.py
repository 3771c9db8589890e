"""Ingestion: raw captures are read, checked for quality, and become sequences with a record each.

A capture that cannot be used is quarantined: it becomes a record that states the reason.
"""

import json
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Self

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.quality import QualityError, QualityLimits, check_quality, measure_quality
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.execution import Executor, open_executor
from pacmo_core.formats.base import Format, FormatError, RawSequence, read_capture
from pacmo_core.store.cache import Cache, CacheEntry, code_hash, short_hash
from pacmo_core.store.files import file_hash
from pacmo_core.store.tables import ClipRecord, QuarantineRecord

BATCH_SIZE = 256  # sequences handed to the processes at a time: what may wait in memory
MIN_PARALLEL = 8  # fewer sequences are read in this process: to start others takes longer

# The code that a reading depends on: an edit of it invalidates the cached readings.
CODE = ("data/*.py", "formats/*.py", "ingestion.py", "store/cache.py", "store/tables.py")
PACKAGES = ("numpy", "scipy")
ARRAYS = ("times", "person_a", "person_b")

Capture = tuple[ClipRecord, Interaction]


@dataclass(frozen=True)
class IngestionSettings:
    """How the captures of one dataset are read.

    Parameters
    ----------
    dataset : its name in the records
    root : the folder that file names are relative to
    format : the raw format, with its settings
    drop_joints : joints left out of every motion
    limits : quality limits of a usable capture
    contact_distance : metres between two joints that touch
    stated_fps : the frame rate that the dataset documents, where its files contain their own
    """

    dataset: str
    root: Path
    format: Format
    drop_joints: tuple[str, ...]
    limits: QualityLimits
    contact_distance: float
    stated_fps: float | None


class ReadingCache:
    """Readings computed before, under the hash of content, settings and code.

    Parameters
    ----------
    folder : of the cache
    settings : everything but the files that a reading depends on, as text
    """

    def __init__(self, folder: Path, settings: str) -> None:
        self._cache = Cache(folder, short_hash(settings, reading_code_hash()))

    def get(self, key: str) -> Capture | QuarantineRecord | None:
        """Return a reading; None if it is not cached."""
        entry = self._cache.get(key)
        if entry is None:
            return None
        if not entry.arrays:
            return QuarantineRecord(**entry.metadata["record"])
        skeleton = Skeleton.from_dict(entry.metadata["skeleton"])
        return ClipRecord(**entry.metadata["record"]), Interaction(skeleton, **entry.arrays)

    def put(self, key: str, reading: Capture | QuarantineRecord) -> None:
        """Add a reading."""
        if isinstance(reading, QuarantineRecord):
            self._cache.put(key, CacheEntry({"record": asdict(reading)}, {}))
            return
        record, interaction = reading
        metadata = {"record": asdict(record), "skeleton": interaction.skeleton.to_dict()}
        arrays = {name: getattr(interaction, name) for name in ARRAYS}
        self._cache.put(key, CacheEntry(metadata, arrays))


def reading_key(sequence: RawSequence, digest: str) -> str:
    """Hash one sequence: its labels, the paths of its files, and their content."""
    fields = {**asdict(sequence), "files": [file.as_posix() for file in sequence.files]}
    return short_hash(json.dumps(fields), digest)


def reading_code_hash() -> str:
    """Hash the code that reads captures and the versions of the packages that it uses."""
    return code_hash(CODE, PACKAGES)


def read_sequences(
    settings: IngestionSettings,
    sequences: Sequence[RawSequence],
    cache: ReadingCache | None = None,
    address: str = "",
) -> Iterator[Capture | QuarantineRecord]:
    """Read sequences in order, in one process a core, and quarantine those that do not fit.

    The first usable sequence determines the skeleton of the dataset. A sequence of another
    skeleton, or with the content of an earlier one (it could be in both training and test data),
    is quarantined.

    Parameters
    ----------
    settings, sequences : what is read, and how
    cache : readings computed before; new ones are added
    address : of a Dask scheduler; if empty, processes of this machine are used
    """
    skeleton, names_by_content = None, dict[str, str]()
    for reading in _read_in_parallel(settings, sequences, cache, address):
        if isinstance(reading, QuarantineRecord):
            yield reading
            continue
        record, interaction = reading
        skeleton = skeleton or interaction.skeleton
        reason = ""
        if interaction.skeleton != skeleton:
            reason = (
                f"{len(interaction.skeleton.joints)} joints ({interaction.skeleton.name}) where "
                f"the first capture of the dataset has {len(skeleton.joints)} ({skeleton.name})"
            )
        elif record.sha256 in names_by_content:
            reason = f"the same content as {names_by_content[record.sha256]}"
        if reason:
            yield QuarantineRecord(record.sequence, record.source_file, record.sha256, 0, reason)
        else:
            names_by_content[record.sha256] = record.sequence
            yield reading


def _read_in_parallel(
    settings: IngestionSettings,
    sequences: Sequence[RawSequence],
    cache: ReadingCache | None,
    address: str,
) -> Iterator[Capture | QuarantineRecord]:
    with _Readers(address) as readers, ThreadPoolExecutor(os.cpu_count()) as hash_threads:
        for start in range(0, len(sequences), BATCH_SIZE):
            batch = sequences[start : start + BATCH_SIZE]
            if cache is None:
                yield from readers.read(settings, batch)
                continue
            keys = list(hash_threads.map(_sequence_key, batch))
            readings = {key: reading for key in keys if (reading := cache.get(key)) is not None}
            missing = {k: s for k, s in zip(keys, batch, strict=True) if k not in readings}
            computed = readers.read(settings, list(missing.values()))
            for key, reading in zip(missing, computed, strict=True):
                cache.put(key, reading)
                readings[key] = reading
            yield from (readings[key] for key in keys)


class _Readers:
    """An executor that is started when there are enough sequences to read in parallel."""

    def __init__(self, address: str) -> None:
        self._address, self._stack = address, ExitStack()
        self._executor: Executor | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def read(
        self, settings: IngestionSettings, sequences: Sequence[RawSequence]
    ) -> Iterator[Capture | QuarantineRecord]:
        """Read sequences in order."""
        read = partial(read_sequence, settings)
        if len(sequences) < MIN_PARALLEL:
            return map(read, sequences)
        if self._address:
            # The working folder of a Dask worker is another one.
            absolute = replace(settings, root=settings.root.resolve())
            read = partial(read_on_worker, reading_code_hash(), absolute)
            sequences = [_resolved(sequence) for sequence in sequences]
        if self._executor is None:
            self._executor = self._stack.enter_context(open_executor(self._address))
        return self._executor.map_ordered(read, sequences)


def read_sequence(settings: IngestionSettings, sequence: RawSequence) -> Capture | QuarantineRecord:
    """Read one sequence and check its quality; a capture that cannot be used is quarantined."""
    names = " + ".join(_relative(file, settings.root) for file in sequence.files)
    digest = file_hash(*sequence.files)
    try:
        reading = read_capture(settings.format, sequence)
        interaction = reading.interaction.without(list(settings.drop_joints))
        quality = measure_quality(interaction, contact_distance=settings.contact_distance)
        check_quality(quality, settings.limits, settings.stated_fps)
    except FormatError as error:
        file = _relative(error.file, settings.root)
        return QuarantineRecord(sequence.name, file, digest, error.line or 0, error.reason)
    except QualityError as error:
        return QuarantineRecord(sequence.name, names, digest, 0, str(error))
    record = ClipRecord(
        clip=sequence.name,
        sequence=sequence.name,
        dataset=settings.dataset,
        action=sequence.action,
        subject_a=sequence.subjects[0],
        subject_b=sequence.subjects[1],
        recording=sequence.recording,
        skeleton=interaction.skeleton.name,
        fps=interaction.fps,
        duration=interaction.duration,
        frames=len(interaction.times),
        start_frame=0,
        source_file=names,
        sha256=digest,
        bone_length_variation=quality.bone_length_variation,
        max_joint_speed=quality.max_joint_speed,
        contact_share=quality.contact_share,
        filled_frames=reading.filled_frames,
    )
    return record, interaction


def read_on_worker(
    code: str, settings: IngestionSettings, sequence: RawSequence
) -> Capture | QuarantineRecord:
    """Read one sequence on a Dask worker, which must run the same code as the client.

    Raises
    ------
    RuntimeError
        If the worker runs other code.
    """
    if reading_code_hash() != code:
        raise RuntimeError("this worker has other code, NumPy or SciPy than the client: restart it")
    return read_sequence(settings, sequence)


def _resolved(sequence: RawSequence) -> RawSequence:
    return replace(sequence, files=tuple(file.resolve() for file in sequence.files))


def _relative(file: Path, root: Path) -> str:
    return file.relative_to(root).as_posix() if file.is_relative_to(root) else file.name


def _sequence_key(sequence: RawSequence) -> str:
    return reading_key(sequence, file_hash(*sequence.files))
