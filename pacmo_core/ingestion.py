"""Ingestion: raw captures are read, checked for quality, and become sequences with a record each.

A capture that cannot be used is quarantined: it becomes a record that states the reason.
"""

import hashlib
import json
import os
import stat
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Self
from urllib.parse import quote

import numpy as np

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.quality import QualityError, QualityLimits, check_quality, measure_quality
from pacmo_core.data.skeleton import (
    DUET15,
    EXPI18,
    INTERHUMAN22,
    NTU25,
    SBU15,
    Skeleton,
    skeleton_difference,
)
from pacmo_core.execution import Executor, open_executor
from pacmo_core.formats.base import Format, FormatError, RawSequence, read_capture
from pacmo_core.formats.inference import implausible, states_unit_or_axis
from pacmo_core.formats.joint_names import UNSTATED, StatedNames, name_joints
from pacmo_core.store.cache import Cache, CacheEntry, code_hash, short_hash
from pacmo_core.store.files import file_hash
from pacmo_core.store.tables import ClipRecord, QuarantineRecord

BATCH_SIZE = 256  # sequences handed to the processes at a time: what may wait in memory
MIN_PARALLEL = 8  # fewer sequences are read in this process: to start others takes longer

# The code that a reading depends on: an edit of it invalidates the cached readings.
CODE = ("data/*.py", "formats/*.py", "ingestion.py", "store/cache.py", "store/tables.py")
PACKAGES = ("numpy", "scipy", "pyarrow")
# A clip's name becomes the name of a file, with what distinguishes a variation and a suffix; file
# systems take 255 bytes. A path is prefixed by the folder of captures or of the quarantine.
MAX_NAME = 180
MAX_PATH_BYTES = 1000
FILE_KINDS = {
    stat.S_IFIFO: "a pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFDIR: "a folder",
}
ARRAYS = ("times", "person_a", "person_b")
# Skeletons in which the captures of another one can be stored.
PUBLISHED = {s.name: s for s in (NTU25, SBU15, DUET15, EXPI18, INTERHUMAN22)}

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
    skeleton : in whose joints motions are stored, but for those left out, such as that of weights
        to continue from; joints that captures lack are estimated. None: the captures' own
    joint_names : which joints of the captures these are, where names do not tell
    limits : quality limits of a usable capture
    contact_distance : metres between two joints that touch
    stated_fps : the frame rate that the dataset documents, where its files contain their own
    synthetic : whether the captures are generated, as those of the embedded default
    """

    dataset: str
    root: Path
    format: Format
    drop_joints: tuple[str, ...]
    limits: QualityLimits
    contact_distance: float
    stated_fps: float | None
    synthetic: bool = False
    skeleton: Skeleton | None = None
    joint_names: StatedNames = UNSTATED


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
    skeleton, with the name of an earlier one, or with its content (it could be in both training and
    test data), is quarantined; so is one with a file that ``file_fault`` refuses.

    Parameters
    ----------
    settings, sequences : what is read, and how
    cache : readings computed before; new ones are added
    address : of a Dask scheduler; if empty, processes of this machine are used
    """
    skeleton, names_by_content = None, dict[str, str]()
    for reading in _read_or_refuse(settings, sequences, cache, address):
        if isinstance(reading, QuarantineRecord):
            yield reading
            continue
        record, interaction = reading
        skeleton = skeleton or interaction.skeleton
        contents = (record.sha256, _motion_hash(interaction))
        known = next((names_by_content[c] for c in contents if c in names_by_content), "")
        whose = "the first capture of the dataset has"
        reason = skeleton_difference(interaction.skeleton, skeleton, whose)
        if not reason and known:
            reason = f"the same content as {known}"
        if reason:
            yield QuarantineRecord(record.sequence, record.source_file, record.sha256, 0, reason)
        else:
            names_by_content |= dict.fromkeys(contents, record.sequence)
            yield reading


def _read_or_refuse(
    settings: IngestionSettings,
    sequences: Sequence[RawSequence],
    cache: ReadingCache | None,
    address: str,
) -> Iterator[Capture | QuarantineRecord]:
    """Read the sequences without a fault of name or file, which is found before one is opened."""
    faults = list(_faults(sequences, settings.root))
    sound = [s for s, fault in zip(sequences, faults, strict=True) if not fault]
    with closing(_read_in_parallel(settings, sound, cache, address)) as readings:
        for sequence, fault in zip(sequences, faults, strict=True):
            if fault:
                names = " + ".join(_relative(file, settings.root) for file in sequence.files)
                yield QuarantineRecord(sequence.name, names, "", 0, fault)
            else:
                yield next(readings)


def _faults(sequences: Sequence[RawSequence], root: Path) -> Iterator[str]:
    """Yield why each sequence cannot be used, by its name and files; empty where it can."""
    resolved, first_files = root.resolve(), dict[str, str]()
    for sequence in sequences:
        faults = (file_fault(file, root, resolved) for file in sequence.files)
        fault = next(filter(None, faults), "") or _name_fault(sequence.name)
        if not fault and sequence.name in first_files:
            fault = f"the name {sequence.name} is that of {first_files[sequence.name]}"
        if not fault:
            first_files[sequence.name] = _relative(sequence.files[0], root)
        yield fault


def file_fault(file: Path, root: Path, resolved_root: Path) -> str:
    """Return why a file is not opened; empty if it may be.

    Opening a pipe waits for ever, a device may have no end, and a link may lead anywhere: only
    regular files, and links to such below the root, are opened.

    Parameters
    ----------
    resolved_root : the root without links
    """
    return _path_fault(_relative(file, root)) or _kind_fault(file, root, resolved_root)


def _path_fault(name: str) -> str:
    if name != os.fsencode(name).decode("utf-8", "replace"):
        return f"its name {name} is not UTF-8"
    length = len(os.fsencode(name))
    if length > MAX_PATH_BYTES:
        return f"its path has {length} bytes; wanted at most {MAX_PATH_BYTES}"
    return ""


def _kind_fault(file: Path, root: Path, resolved_root: Path) -> str:
    name = _relative(file, root)
    try:
        target = file.resolve(strict=True)
        mode = target.stat().st_mode
    except (OSError, RuntimeError):  # RuntimeError: a loop, up to Python 3.12
        return f"{name} is a link to nothing" if file.is_symlink() else f"there is no file {name}"
    faults = {
        f"{name} is a link out of the folder, to {target}": not target.is_relative_to(
            resolved_root
        ),
        f"{name} is {FILE_KINDS.get(stat.S_IFMT(mode), 'special')}, no file": not stat.S_ISREG(
            mode
        ),
        f"{name} cannot be read: permission denied": not os.access(file, os.R_OK),
    }
    return next((text for text, is_so in faults.items() if is_so), "")


def _name_fault(name: str) -> str:
    length = len(quote(name, safe=""))
    if length <= MAX_NAME:
        return ""
    return f"its name has {length} characters ('/' counts three); wanted at most {MAX_NAME}"


def _read_in_parallel(
    settings: IngestionSettings,
    sequences: Sequence[RawSequence],
    cache: ReadingCache | None,
    address: str,
) -> Generator[Capture | QuarantineRecord]:
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
        _check_plausible(settings.format, sequence, reading.interaction)
        interaction = _in_joints(reading.interaction, settings, sequence)
        _check_sides(sequence, interaction)
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
        synthetic=settings.synthetic,
    )
    return record, interaction


def _motion_hash(interaction: Interaction) -> str:
    """Hash the motion to a tenth of a millimetre: the same take in two files is one capture."""
    people = np.stack([interaction.person_a, interaction.person_b])
    return hashlib.sha256(np.rint(1e4 * people).astype(np.int64).tobytes()).hexdigest()


def _in_joints(
    interaction: Interaction, settings: IngestionSettings, sequence: RawSequence
) -> Interaction:
    """Express both people in the joints that are stored.

    Raises
    ------
    FormatError
        If a capture lacks a joint.
    """
    drop = list(settings.drop_joints)
    setting = "drop_joints" if settings.skeleton is None else "skeleton"
    try:
        if settings.skeleton is None:
            return interaction.without(drop)
        skeleton = settings.skeleton.without(drop)
        names = name_joints(interaction.skeleton, skeleton, settings.joint_names, estimates=True)
    except ValueError as error:
        raise FormatError(sequence.files[0], f"{setting}: {error}") from error
    return replace(
        interaction,
        skeleton=skeleton,
        person_a=names.apply(interaction.person_a),
        person_b=names.apply(interaction.person_b),
    )


def _check_sides(sequence: RawSequence, interaction: Interaction) -> None:
    """Raise FormatError if no joint is of a left and a right side: nobody would face anywhere."""
    if not interaction.skeleton.left_right:
        joints = ", ".join(interaction.skeleton.joints[:8])
        raise FormatError(
            sequence.files[0],
            f"no joints of a left and a right side, such as left_hip and right_hip; got {joints}",
        )


def _check_plausible(form: Format, sequence: RawSequence, interaction: Interaction) -> None:
    """Raise FormatError if the stated unit or axis makes impossible people."""
    if not states_unit_or_axis(form):
        return
    people = (interaction.person_a, interaction.person_b)
    up = getattr(form, "up_axis", None) or getattr(form, "up", None)
    fault = implausible([(interaction.skeleton, motion) for motion in people], [up, up])
    if fault:
        raise FormatError(sequence.files[min(fault[0], len(sequence.files) - 1)], fault[1])


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
