"""Copy the clips that are finished; make, finish and write the rest.

A variation's name is its clip's, ``~`` and what it is; ``~`` sorts after every character of a
clip's name.
"""

import logging
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pacmo_core.augmentation.bodies import measure_body
from pacmo_core.augmentation.clip_files import (
    ClipFiles,
    clip_key,
    variation_from_entry,
    variation_to_entry,
    write_clip_files,
)
from pacmo_core.augmentation.filter import VariationLimits
from pacmo_core.augmentation.plan import Plan, Variation, plan_variations
from pacmo_core.augmentation.run import (
    Batch,
    BatchResult,
    SolvedVariation,
    body_key,
    solve_on_cluster,
    solve_with_processes,
    solver_key,
    source_key,
)
from pacmo_core.augmentation.segments import segments
from pacmo_core.interaction_mesh import MAX_BATCH, Settings
from pacmo_core.store.cache import Cache
from pacmo_core.store.tables import (
    VARIATIONS,
    ClipRecord,
    VariationRecord,
    write_rows,
    write_variations,
)
from stages._cluster import scheduler_address
from stages._files import CLIPS
from stages._sources import Family

LOG = logging.getLogger(__name__)
COPIERS = 2  # threads: more wait for each other


@dataclass(frozen=True)
class Making:
    """How clips are varied, and where what was made before is kept."""

    plan: Plan
    solver: Settings
    limits: VariationLimits
    variations: Cache  # whatever the plan
    clips: Cache  # files of clips with all variations of the plan


@dataclass(frozen=True)
class Waiting:
    """A clip that is not finished, and the hashes under which all of it is kept."""

    clip: str
    key: str
    source: str
    variations: list[tuple[str, Variation]]


@dataclass(frozen=True)
class Found:
    """The keys of the variations in the cache, and why sources were refused."""

    cached: set[str] = field(default_factory=set)
    refused: dict[str, str] = field(default_factory=dict)

    def lacks(self, clip: Waiting) -> list[tuple[str, Variation]]:
        """List what a clip still waits for: nothing, once its source is refused."""
        if clip.source in self.refused:
            return []
        return [one for one in clip.variations if entry_key(clip.source, one[0]) not in self.cached]

    def outcomes(
        self, clip: Waiting, cache: Cache
    ) -> Iterator[tuple[Variation, SolvedVariation | str]]:
        """Read what came of each variation."""
        for body, variation in clip.variations:
            entry = cache.get(entry_key(clip.source, body))
            made = variation_from_entry(entry) if entry else self.refused[clip.source]
            yield variation, made


def entry_key(source: str, body: str) -> str:
    """Return the key of a variation in the cache."""
    return f"{source}/{body}"


def write_family(folder: Path, family: Family, making: Making) -> list[VariationRecord]:
    """Write what is varied, what comes of it and the facts of both, a file a clip."""
    rows, waiting = _copied(folder, family, making)
    n_new = sum(len(one.variations) for one in waiting)
    LOG.info("%s: %d planned, %d not finished before", family.name, len(rows) + n_new, n_new)
    for one, found in _made(family, waiting, making):
        source = family.read(one.clip)
        outcomes = found.outcomes(one, making.variations)
        new = write_clip_files(folder, one.clip, source, outcomes, making.limits)
        making.clips.put(one.key, new.to_entry())
        rows += new.rows
    rows.sort(key=lambda row: row.variation)
    names = [segment.name for segment in segments(family.read(min(family.clips)).skeleton)]
    write_variations(folder / VARIATIONS, rows, names)
    write_rows(folder / CLIPS, ClipRecord, list(family.clips.values()))
    return rows


def _copied(
    folder: Path, family: Family, making: Making
) -> tuple[list[VariationRecord], list[Waiting]]:
    """Copy what is finished, beside the reading of what it must rest on; plan the rest."""
    asked = []
    with ThreadPoolExecutor(COPIERS) as pool:
        for clip in family.clips:
            source = family.read(clip)
            known = source_key(source)
            key = clip_key(clip, known, source)
            asked.append((clip, key, known, pool.submit(_copy, making.clips, key, folder, clip)))
    rows, waiting = list[VariationRecord](), []
    for clip, key, known, answer in asked:
        before = answer.result()
        if before is None:
            waiting.append(Waiting(clip, key, known, _planned(clip, family, making.plan)))
        else:
            rows += before
    return rows, waiting


def _copy(cache: Cache, key: str, folder: Path, clip: str) -> list[VariationRecord] | None:
    """Write the cached files of a clip and return its records; None if it is not cached."""
    entry = cache.get(key)
    if entry is None:
        return None
    files = ClipFiles.from_entry(entry)
    files.write(folder, clip)
    return files.rows


def _planned(clip: str, family: Family, plan: Plan) -> list[tuple[str, Variation]]:
    """Plan a clip's variations, each with the hash of its bodies."""
    source = family.read(clip)
    bodies = (
        measure_body(source.person_a, source.skeleton),
        measure_body(source.person_b, source.skeleton),
    )
    found = plan_variations(plan, bodies, clip)
    return [(body_key(variation.scales), variation) for variation in found]


def _made(
    family: Family, waiting: Sequence[Waiting], making: Making
) -> Iterator[tuple[Waiting, Found]]:
    """Yield clips as all their variations are there; solve the missing ones, a batch at a time."""
    found = Found()
    keys = {entry_key(one.source, body) for one in waiting for body, _ in one.variations}
    found.cached.update(key for key in sorted(keys) if making.variations.get(key))
    batches = list(_batches(family, waiting, found, making.solver))
    n_bodies, n_done = sum(len(batch.body_keys) for batch in batches), 0
    left: dict[str, list[Waiting]] = {}
    for one in waiting:
        if found.lacks(one):
            left.setdefault(one.source, []).append(one)
        else:
            yield one, found
    for outcome in _solved(batches):
        _keep(outcome, found, making.variations)
        n_done += len(outcome.variations)
        LOG.info("%s: %d of %d made", family.name, n_done, n_bodies)
        if not any(found.lacks(one) for one in left.get(outcome.source_key, ())):
            for one in left.pop(outcome.source_key, ()):
                yield one, found


def _keep(outcome: BatchResult, found: Found, cache: Cache) -> None:
    """Add the variations of a solved batch to the cache."""
    if outcome.error:
        found.refused[outcome.source_key] = outcome.error
    for body, made in outcome.variations.items():
        cache.put(entry_key(outcome.source_key, body), variation_to_entry(made))
        found.cached.add(entry_key(outcome.source_key, body))


def _solved(batches: list[Batch]) -> Iterator[BatchResult]:
    address = scheduler_address()
    if address:
        return solve_on_cluster(batches, address)
    return solve_with_processes(batches, processes=os.cpu_count() or 1)


def _batches(
    family: Family, waiting: Sequence[Waiting], found: Found, settings: Settings
) -> Iterator[Batch]:
    """Gather what one source lacks, a batch of the solver at a time."""
    sources: dict[str, dict[str, Variation]] = {}
    clips: dict[str, str] = {}
    for one in waiting:
        if lacking := found.lacks(one):
            sources.setdefault(one.source, {}).update(lacking)
            clips.setdefault(one.source, one.clip)
    for key, bodies in sources.items():
        names = list(bodies)
        source = family.read(clips[key])
        for first in range(0, len(names), MAX_BATCH):
            body_keys = tuple(names[first : first + MAX_BATCH])
            scales = np.stack([np.concatenate(bodies[name].scales) for name in body_keys])
            yield Batch(key, solver_key(settings), source, settings, scales, body_keys)
