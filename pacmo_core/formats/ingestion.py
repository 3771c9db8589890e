"""Read found sequences side by side; what cannot be used becomes a row that says why."""

import hashlib
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Self

from pacmo_core.data.quality import Limits, QualityError, check, measure
from pacmo_core.execution.cluster import Cluster
from pacmo_core.execution.processes import Processes
from pacmo_core.formats.base import Format, FormatError, RawSequence
from pacmo_core.store.clips import ClipFacts, QuarantineFacts
from pacmo_core.store.readings import Readings, Usable, code_key, reading_key

BATCH = 256  # sequences handed to the processes at a time: what may wait in memory
FEW = 8  # fewer are read here: to start processes takes longer


@dataclass(frozen=True)
class Recipe:
    """How the captures of one set are read.

    Parameters
    ----------
    dataset : its name in the facts
    root : the folder that files are named relative to
    format : the raw format, its settings fixed
    drop_joints : joints left out of every motion
    limits : what a usable capture keeps within
    contact_distance : metres between two joints that touch
    stated_fps : the rate that the set claims, where its files state their own
    """

    dataset: str
    root: Path
    format: Format
    drop_joints: tuple[str, ...]
    limits: Limits
    contact_distance: float
    stated_fps: float | None


def read_sequences(
    recipe: Recipe,
    sequences: Sequence[RawSequence],
    kept: Readings | None = None,
    address: str = "",
) -> Iterator[Usable | QuarantineFacts]:
    """Read sequences in order, one process a core, and keep those that fit the set.

    The first usable sequence fixes the set's skeleton. One that has another, or the content of an
    earlier one (it could stand on both sides of a split), is put aside.

    Parameters
    ----------
    recipe, sequences : what is read, and how
    kept : readings that were made before; those made now are added
    address : of a Dask scheduler to read on; empty means this machine's processes
    """
    skeleton, seen = None, dict[str, str]()
    for outcome in _read_side_by_side(recipe, sequences, kept, address):
        if isinstance(outcome, QuarantineFacts):
            yield outcome
            continue
        facts, interaction = outcome
        skeleton = skeleton or interaction.skeleton
        reason = ""
        if interaction.skeleton != skeleton:
            reason = (
                f"{len(interaction.skeleton.joints)} joints ({interaction.skeleton.name}) where "
                f"the set's first capture has {len(skeleton.joints)} ({skeleton.name})"
            )
        elif facts.sha256 in seen:
            reason = f"the same content as {seen[facts.sha256]}"
        if reason:
            yield QuarantineFacts(facts.sequence, facts.source_file, facts.sha256, 0, reason)
        else:
            seen[facts.sha256] = facts.sequence
            yield outcome


def _read_side_by_side(
    recipe: Recipe, sequences: Sequence[RawSequence], kept: Readings | None, address: str
) -> Iterator[Usable | QuarantineFacts]:
    with _Readers(address) as readers, ThreadPoolExecutor(os.cpu_count()) as hashers:
        for start in range(0, len(sequences), BATCH):
            batch = sequences[start : start + BATCH]
            if kept is None:
                yield from readers.read(recipe, batch)
                continue
            keys = list(hashers.map(_key, batch))
            known = kept.get(keys)
            new = {key: s for key, s in zip(keys, batch, strict=True) if key not in known}
            made = dict(zip(new, readers.read(recipe, list(new.values())), strict=True))
            kept.keep(made)
            for key in keys:
                yield known[key] if key in known else made[key]


class _Readers:
    """Processes that read side by side, here or on a cluster, once there is enough to read."""

    def __init__(self, address: str) -> None:
        self._address, self._started = address, ExitStack()
        self._workers: Cluster | Processes | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._started.close()

    def read(
        self, recipe: Recipe, sequences: Sequence[RawSequence]
    ) -> Iterator[Usable | QuarantineFacts]:
        """Read in order."""
        do = partial(read_sequence, recipe)
        if len(sequences) < FEW:
            return map(do, sequences)
        if self._address:
            # Workers stand in folders of their own.
            do = partial(read_elsewhere, code_key(), replace(recipe, root=recipe.root.resolve()))
            sequences = [_resolved(sequence) for sequence in sequences]
        if self._workers is None:
            address = self._address
            self._workers = Cluster(address) if address else Processes(os.cpu_count() or 1)
            self._started.enter_context(self._workers)
        return self._workers.in_order(do, sequences)


def read_sequence(recipe: Recipe, sequence: RawSequence) -> Usable | QuarantineFacts:
    """Read and measure one sequence, or say why it is put aside."""
    names = " + ".join(_relative(file, recipe.root) for file in sequence.files)
    digest = _content_hash(sequence.files)
    try:
        reading = recipe.format.read(sequence)
        interaction = reading.interaction.without(list(recipe.drop_joints))
        quality = measure(interaction, contact_distance=recipe.contact_distance)
        check(quality, recipe.limits, recipe.stated_fps)
    except FormatError as fault:
        file = _relative(fault.file, recipe.root)
        return QuarantineFacts(sequence.name, file, digest, fault.line or 0, fault.reason)
    except QualityError as fault:
        return QuarantineFacts(sequence.name, names, digest, 0, str(fault))
    facts = ClipFacts(
        clip=sequence.name,
        sequence=sequence.name,
        dataset=recipe.dataset,
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
    return facts, interaction


def read_elsewhere(code: str, recipe: Recipe, sequence: RawSequence) -> Usable | QuarantineFacts:
    """Read one sequence on a worker that runs the code of who asks.

    Raises
    ------
    RuntimeError
        If it runs other code.
    """
    if code_key() != code:
        raise RuntimeError("this worker has other code, NumPy or SciPy than who asks: restart it")
    return read_sequence(recipe, sequence)


def _resolved(sequence: RawSequence) -> RawSequence:
    return replace(sequence, files=tuple(file.resolve() for file in sequence.files))


def _relative(file: Path, root: Path) -> str:
    return file.relative_to(root).as_posix() if file.is_relative_to(root) else file.name


def _key(sequence: RawSequence) -> str:
    return reading_key(sequence, _content_hash(sequence.files))


def _content_hash(files: tuple[Path, ...]) -> str:
    digest = hashlib.sha256()
    for file in files:
        digest.update(file.read_bytes())
    return digest.hexdigest()
