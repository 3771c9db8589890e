"""The files of one varied clip: its source, its variations, good or failed, and their records.

Both the variations and the files are cached (``pacmo_core.store.cache``): a variation under the
hash of solver, code, source and bodies, the files under the hash of all that they depend on.
"""

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from math import inf
from pathlib import Path

import numpy as np

from pacmo_core.augmentation.filter import VariationLimits, max_limit_ratio, rejection_reason
from pacmo_core.augmentation.plan import Plan, Variation
from pacmo_core.augmentation.run import SolvedVariation
from pacmo_core.augmentation.segments import segments
from pacmo_core.data.interaction import Interaction
from pacmo_core.data.names import variation_name
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.store.cache import CacheEntry, code_hash, short_hash
from pacmo_core.store.files import atomic_file
from pacmo_core.store.motions import motion_file, write_motions
from pacmo_core.store.tables import ACCEPTED, FAILED, SOURCES, VariationRecord

# The code that the files depend on, besides the code that computes variations.
CODE = ("data/*.py", "store/*.py", "augmentation/*.py")
PACKAGES = ("numpy", "pyarrow")
RECORDS = "records"
MOTIONS = "motions"


@dataclass(frozen=True)
class ClipFiles:
    """What one clip adds to the folder of its dataset.

    Parameters
    ----------
    rows : records of its variations
    files : Parquet files by the folder that they are in; a folder without motions has none
    """

    rows: list[VariationRecord]
    files: dict[str, bytes]

    def write(self, dataset: Path, clip: str) -> None:
        """Write the files into the folder of a dataset, each atomically."""
        for folder, data in self.files.items():
            with atomic_file(motion_file(dataset / folder, clip), sync=False) as partial:
                partial.write_bytes(data)

    def to_entry(self) -> CacheEntry:
        """Convert to an entry of a cache."""
        arrays = {name: np.frombuffer(data, np.uint8) for name, data in self.files.items()}
        return CacheEntry({RECORDS: [asdict(row) for row in self.rows]}, arrays)

    @classmethod
    def from_entry(cls, entry: CacheEntry) -> "ClipFiles":
        """Convert from an entry of a cache."""
        rows = [VariationRecord(**row) for row in entry.metadata[RECORDS]]
        return cls(rows, {name: array.tobytes() for name, array in entry.arrays.items()})


def variation_to_entry(made: SolvedVariation) -> CacheEntry:
    """Convert a variation to an entry of a cache."""
    return CacheEntry(made.figures, {MOTIONS: made.motions})


def variation_from_entry(entry: CacheEntry) -> SolvedVariation:
    """Convert a variation from an entry of a cache."""
    return SolvedVariation(entry.arrays[MOTIONS], entry.metadata)


def settings_key(maker: str, plan: Plan, bounds: VariationLimits) -> str:
    """Hash everything but the clip that its files depend on.

    Parameters
    ----------
    maker : the hash of settings and code that compute variations
    """
    text = json.dumps([asdict(plan), asdict(bounds), code_hash(CODE, PACKAGES)])
    return short_hash(maker, text)


def clip_key(clip: str, source: str, interaction: Interaction) -> str:
    """Hash one clip: its name, the key of its motions, and what that key does not cover."""
    text = json.dumps([clip, source, interaction.skeleton.name])
    return short_hash(text, interaction.times.astype("<f8").tobytes())


def write_clip_files(
    dataset: Path,
    clip: str,
    source: Interaction,
    made: Iterable[tuple[Variation, SolvedVariation | str]],
    bounds: VariationLimits,
) -> ClipFiles:
    """Write the variations of a clip into the folder of its dataset.

    Parameters
    ----------
    made : the variations by ascending name, each with its motion, or why the source was refused
    """
    rows = []
    motions: dict[str, dict[str, Interaction]] = {SOURCES: {clip: source}, ACCEPTED: {}, FAILED: {}}
    for variation, outcome in made:
        row = facts_of(clip, variation, outcome, source.skeleton, bounds)
        rows.append(row)
        if isinstance(outcome, SolvedVariation):
            varied = Interaction(source.skeleton, source.times, *outcome.motions)
            motions[ACCEPTED if row.accepted else FAILED][row.variation] = varied
    files = {}
    for folder, by_name in motions.items():
        if by_name:
            path = motion_file(dataset / folder, clip)
            with write_motions(path, source.skeleton) as writer:
                for name, motion in by_name.items():
                    writer.add(name, motion)
            files[folder] = path.read_bytes()
    return ClipFiles(rows, files)


def facts_of(
    clip: str,
    variation: Variation,
    outcome: SolvedVariation | str,
    skeleton: Skeleton,
    bounds: VariationLimits,
) -> VariationRecord:
    """Say what a variation is, and whether it is kept."""
    refused = isinstance(outcome, str)
    figures = {} if isinstance(outcome, str) else outcome.figures
    reason = f"refused: {outcome}" if refused else rejection_reason(figures, bounds)
    names = [segment.name for segment in segments(skeleton)]
    a, b = (dict(zip(names, own.tolist(), strict=True)) for own in variation.scales)
    return VariationRecord(
        variation=variation_name(clip, variation.name),
        clip=clip,
        kind=variation.kind,
        accepted=not reason,
        reason=reason,
        limit_ratio=max_limit_ratio(figures, bounds) if figures else inf,
        measurements=figures,
        scales_a=a,
        scales_b=b,
    )
