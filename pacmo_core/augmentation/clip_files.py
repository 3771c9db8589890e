"""The files of one varied clip: its source, its variations, accepted or failed, and their records.

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
from pacmo_core.data.interaction import Interaction
from pacmo_core.data.names import variation_name
from pacmo_core.data.segments import segments
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
    """The files of one clip in the folder of its dataset, and the records of its variations.

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


def variation_to_entry(variation: SolvedVariation) -> CacheEntry:
    """Convert a variation to an entry of a cache."""
    return CacheEntry(variation.measurements, {MOTIONS: variation.motions})


def variation_from_entry(entry: CacheEntry) -> SolvedVariation:
    """Convert a variation from an entry of a cache."""
    return SolvedVariation(entry.arrays[MOTIONS], entry.metadata)


def settings_key(solver: str, plan: Plan, limits: VariationLimits) -> str:
    """Hash everything but the clip that its files depend on.

    Parameters
    ----------
    solver : hash of the solver's settings and code (``run.solver_key``)
    """
    text = json.dumps([asdict(plan), asdict(limits), code_hash(CODE, PACKAGES)])
    return short_hash(solver, text)


def clip_key(clip: str, source: str, interaction: Interaction) -> str:
    """Hash one clip: its name, the key of its motions, and what that key does not cover."""
    text = json.dumps([clip, source, interaction.skeleton.name])
    return short_hash(text, interaction.times.astype("<f8").tobytes())


def write_clip_files(
    dataset: Path,
    clip: str,
    source: Interaction,
    results: Iterable[tuple[Variation, SolvedVariation | str]],
    limits: VariationLimits,
) -> ClipFiles:
    """Write the variations of a clip into the folder of its dataset.

    Parameters
    ----------
    results : the variations by ascending name, each with its solution, or with the error of the
        solver
    """
    rows = []
    motions: dict[str, dict[str, Interaction]] = {SOURCES: {clip: source}, ACCEPTED: {}, FAILED: {}}
    for variation, result in results:
        row = variation_record(clip, variation, result, source.skeleton, limits)
        rows.append(row)
        if isinstance(result, SolvedVariation):
            varied = Interaction(source.skeleton, source.times, *result.motions)
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


def variation_record(
    clip: str,
    variation: Variation,
    result: SolvedVariation | str,
    skeleton: Skeleton,
    limits: VariationLimits,
) -> VariationRecord:
    """Return the record of a variation: bodies, measurements, and whether it is accepted."""
    if isinstance(result, str):
        measurements, reason = {}, f"refused: {result}"
    else:
        measurements = result.measurements
        reason = rejection_reason(measurements, limits)
    names = [segment.name for segment in segments(skeleton)]
    scales_a, scales_b = (
        dict(zip(names, scales.tolist(), strict=True)) for scales in variation.scales
    )
    return VariationRecord(
        variation=variation_name(clip, variation.name),
        clip=clip,
        kind=variation.kind,
        accepted=not reason,
        reason=reason,
        limit_ratio=max_limit_ratio(measurements, limits) if measurements else inf,
        measurements=measurements,
        scales_a=scales_a,
        scales_b=scales_b,
    )
