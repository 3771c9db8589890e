"""What is varied: clips of the experiment, and captures of a second skeleton beside them."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

from pacmo_core.augmentation.filter import Candidate, mean_near_pairs, select_clips
from pacmo_core.data.interaction import Interaction
from pacmo_core.data.quality import QualityLimits
from pacmo_core.data.splits import cut_sequence
from pacmo_core.formats.registry import open_format
from pacmo_core.ingestion import IngestionSettings, read_sequences
from pacmo_core.store.motions import MotionReader
from pacmo_core.store.tables import ClipRecord, QuarantineRecord, read_rows
from stages._files import CLIPS, MOTIONS


@dataclass(frozen=True)
class Choice:
    """Which clips of a family are varied."""

    include: tuple[str, ...]  # patterns of clips' names
    max_per_sequence: int | None  # those with the most near pairs of joints
    max_clips: int | None  # in all; one of each action before a second of any
    near_distance: float  # metres between joints that count as near

    def must_choose(self, n_clips: int) -> bool:
        """Say whether of a sequence's so many clips some may be left out."""
        of_each = n_clips if self.max_per_sequence is None else self.max_per_sequence
        return self.max_clips is not None or n_clips > of_each


@dataclass(frozen=True)
class SecondDataset:
    """Captures of another skeleton, read as ``ingest`` and ``cut`` do; none without a format."""

    dataset: str
    raw: str  # the folder, which is also on the command line
    format: str | None
    settings: dict[str, Any]
    include: tuple[str, ...]
    drop_joints: tuple[str, ...]
    stated_fps: float | None
    limits: QualityLimits
    contact_distance: float
    clip_seconds: float


@dataclass(frozen=True)
class Family:
    """Sources of one skeleton.

    Parameters
    ----------
    name : of the data set
    clips : facts of the chosen ones, by name, sorted
    read : from a name to the clip
    """

    name: str
    clips: dict[str, ClipRecord]
    read: Callable[[str], Interaction]


def own_family(clips: Path, choice: Choice) -> Family:
    """Choose among the experiment's clips."""
    facts = {row.clip: row for row in read_rows(clips / CLIPS, ClipRecord)}
    read = MotionReader(clips / MOTIONS).read
    chosen = _chosen(facts, read, choice, clips)
    return Family(next(iter(chosen.values())).dataset, chosen, read)


def second_family(second: SecondDataset, raw: Path, choice: Choice) -> Iterator[Family]:
    """Choose among captures of the second skeleton, where there are any.

    Raises
    ------
    ValueError
        If none of them is usable.
    """
    if second.format is None:
        return
    rows: dict[str, ClipRecord] = {}
    clips: dict[str, Interaction] = {}
    for facts, whole in _captures(second, raw):
        for name, start, clip in cut_sequence(facts.sequence, whole, second.clip_seconds):
            clips[name] = clip
            rows[name] = facts.for_clip(name, start, clip)
    read = clips.__getitem__
    yield Family(second.dataset, _chosen(rows, read, choice, raw), read)


def _captures(second: SecondDataset, raw: Path) -> Iterator[tuple[ClipRecord, Interaction]]:
    raw_format = open_format(second.format or "", second.settings)
    found = sorted(raw_format.find(raw), key=lambda sequence: sequence.name)
    recipe = IngestionSettings(
        dataset=second.dataset,
        root=raw,
        format=raw_format,
        drop_joints=second.drop_joints,
        limits=second.limits,
        contact_distance=second.contact_distance,
        stated_fps=second.stated_fps,
    )
    wanted = [
        sequence
        for sequence in found
        if _is_included(sequence.files[0].relative_to(raw).as_posix(), second.include)
    ]
    for outcome in read_sequences(recipe, wanted):
        if not isinstance(outcome, QuarantineRecord):
            yield outcome


def _is_included(name: str, patterns: tuple[str, ...]) -> bool:
    return any(fnmatch(name, pattern) for pattern in patterns)


def _chosen(
    facts: Mapping[str, ClipRecord],
    read: Callable[[str], Interaction],
    choice: Choice,
    where: Path,
) -> dict[str, ClipRecord]:
    """Choose clips by name; only those among which there is a choice are looked into."""
    rows = [row for row in facts.values() if _is_included(row.clip, choice.include)]
    if not rows:
        raise ValueError(f"{where}: no clip fits {', '.join(choice.include)}")
    n_clips = Counter(row.sequence for row in rows)
    candidates = []
    for row in rows:
        must_look = choice.must_choose(n_clips[row.sequence])
        nearness = mean_near_pairs(read(row.clip), choice.near_distance) if must_look else 0.0
        candidates.append(Candidate(row.clip, row.sequence, row.action, nearness))
    names = select_clips(
        candidates, max_per_sequence=choice.max_per_sequence, max_clips=choice.max_clips
    )
    return {name: facts[name] for name in names}
