"""Retarget clips to other bodies, and mark the variations that training may use.

Usage: python -m stages.augment --cache=DIR CLIPS SECOND VARIATIONS METRICS.json

SECOND is a folder of captures of another skeleton, whose variations are a second dataset. DIR
caches variations and files of clips across runs (DVC does not manage it): only new ones are
computed, and the result has the same bytes as without it. DASK_SCHEDULER_ADDRESS names a cluster.
"""

import argparse
import logging
import os
import shutil
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field, replace
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from pacmo_core.augmentation.bodies import measure_body
from pacmo_core.augmentation.clip_files import (
    ClipFiles,
    clip_key,
    settings_key,
    variation_from_entry,
    variation_to_entry,
    write_clip_files,
)
from pacmo_core.augmentation.filter import (
    Candidate,
    VariationLimits,
    exceeded_limits,
    mean_near_pairs,
    select_clips,
)
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
from pacmo_core.augmentation.solutions import Solution
from pacmo_core.data.interaction import Interaction
from pacmo_core.data.names import clip_name, matches_any
from pacmo_core.data.quality import QualityLimits
from pacmo_core.data.segments import segments
from pacmo_core.data.skeleton import OBJECT
from pacmo_core.data.splits import check_clip_seconds, window_edges
from pacmo_core.formats.base import check_fps
from pacmo_core.ingestion import IngestionSettings, read_sequences
from pacmo_core.interaction_mesh import MAX_BATCH, Settings
from pacmo_core.store.cache import Cache
from pacmo_core.store.motions import MotionReader
from pacmo_core.store.tables import (
    VARIATIONS,
    ClipRecord,
    QuarantineRecord,
    VariationRecord,
    read_rows,
    write_rows,
    write_variations,
)
from stages.common.captures import find_captures, open_captures
from stages.common.files import CLIPS, MOTIONS, SOLVER, scheduler_address, write_json
from stages.common.params import read_params, run_stage


@dataclass(frozen=True)
class ClipSelection:
    """The clips of a dataset that are varied."""

    include: tuple[str, ...]  # patterns of clips' names
    max_per_sequence: int | None  # those with the most near pairs of joints
    max_clips: int | None  # in all; one of each action before a second of any
    near_distance: float  # metres between joints that count as near

    def must_select(self, n_clips: int) -> bool:
        """Return whether some of ``n_clips`` clips of a sequence may be left out."""
        max_clips = n_clips if self.max_per_sequence is None else self.max_per_sequence
        return self.max_clips is not None or n_clips > max_clips


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

    def __post_init__(self) -> None:
        check_clip_seconds(self.clip_seconds)
        if self.stated_fps is not None:
            check_fps(self.stated_fps, "stated_fps")


@dataclass(frozen=True)
class SourceDataset:
    """Sources of one skeleton.

    Parameters
    ----------
    name : of the dataset
    clips : records of the selected clips, by name, sorted
    read : reads a clip by name
    """

    name: str
    clips: dict[str, ClipRecord]
    read: Callable[[str], Interaction]


def main_dataset(clips: Path, selection: ClipSelection) -> SourceDataset:
    """Select clips of the experiment, without what a person holds, which no bone leads to."""
    facts = {row.clip: row for row in read_rows(clips / CLIPS, ClipRecord)}
    reader = MotionReader(clips / MOTIONS)

    def read(clip: str) -> Interaction:
        found = reader.read(clip)
        return found.without([OBJECT]) if OBJECT in found.skeleton.joints else found

    selected = _select_clips(facts, read, selection, clips)
    return SourceDataset(next(iter(selected.values())).dataset, selected, read)


def second_dataset(
    second: SecondDataset, raw: Path, selection: ClipSelection
) -> Iterator[SourceDataset]:
    """Select clips of the second dataset; yields nothing if there is none.

    Raises
    ------
    ValueError
        If none of them is usable.
    """
    if second.format is None:
        return
    rows: dict[str, ClipRecord] = {}
    clips: dict[str, Interaction] = {}
    for facts, sequence in _read_captures(second, raw):
        edges = window_edges(len(sequence.times), sequence.fps, second.clip_seconds)
        for number, (start, stop) in enumerate(edges):
            name = clip_name(facts.sequence, number, len(edges))
            clips[name] = sequence.frames(start, stop)
            record = replace(facts, clip=name, duration=clips[name].duration, frames=stop - start)
            rows[name] = replace(record, start_frame=start)
    read = clips.__getitem__
    yield SourceDataset(second.dataset, _select_clips(rows, read, selection, raw), read)


def _read_captures(second: SecondDataset, raw: Path) -> Iterator[tuple[ClipRecord, Interaction]]:
    raw_format = open_captures("augment.second_dataset", second.format or "", second.settings)
    sequences = find_captures(raw_format, raw)
    settings = IngestionSettings(
        dataset=second.dataset,
        root=raw,
        format=raw_format,
        drop_joints=second.drop_joints,
        limits=second.limits,
        contact_distance=second.contact_distance,
        stated_fps=second.stated_fps,
    )
    included = [
        sequence
        for sequence in sequences
        if matches_any(sequence.files[0].relative_to(raw).as_posix(), second.include)
    ]
    for outcome in read_sequences(settings, included):
        if not isinstance(outcome, QuarantineRecord):
            yield outcome


def _select_clips(
    facts: Mapping[str, ClipRecord],
    read: Callable[[str], Interaction],
    selection: ClipSelection,
    where: Path,
) -> dict[str, ClipRecord]:
    """Select clips; motions are read only of sequences from which clips may be left out."""
    rows = [row for row in facts.values() if matches_any(row.clip, selection.include)]
    if not rows:
        raise ValueError(f"{where}: no clip matches {', '.join(selection.include)}")
    n_clips = Counter(row.sequence for row in rows)
    candidates = []
    for row in rows:
        is_read = selection.must_select(n_clips[row.sequence])
        near_pairs = mean_near_pairs(read(row.clip), selection.near_distance) if is_read else 0.0
        candidates.append(Candidate(row.clip, row.sequence, row.action, near_pairs))
    names = select_clips(
        candidates, max_per_sequence=selection.max_per_sequence, max_clips=selection.max_clips
    )
    return {name: facts[name] for name in names}


LOG = logging.getLogger(__name__)
N_COPY_THREADS = 2  # more are not faster


@dataclass(frozen=True)
class Augmentation:
    """Settings of the augmentation, and its caches."""

    plan: Plan
    solver: Settings
    limits: VariationLimits
    variations: Cache  # of single variations, independent of the plan
    clips: Cache  # of the files of a clip with all variations of the plan


@dataclass(frozen=True)
class PendingClip:
    """A clip that is not in the cache of clips, and its keys."""

    clip: str
    key: str
    source: str
    variations: list[tuple[str, Variation]]


@dataclass(frozen=True)
class CacheState:
    """The keys of the cached variations, and the reasons why sources were refused."""

    cached: set[str] = field(default_factory=set)
    refused: dict[str, str] = field(default_factory=dict)

    def missing(self, clip: PendingClip) -> list[tuple[str, Variation]]:
        """List the variations of a clip that are not cached; none if its source is refused."""
        if clip.source in self.refused:
            return []
        return [
            (body, variation)
            for body, variation in clip.variations
            if variation_key(clip.source, body) not in self.cached
        ]

    def outcomes(
        self, clip: PendingClip, cache: Cache
    ) -> Iterator[tuple[Variation, SolvedVariation | str]]:
        """Yield each variation with its solution, or with the reason why there is none."""
        for body, variation in clip.variations:
            entry = cache.get(variation_key(clip.source, body))
            solution = variation_from_entry(entry) if entry else self.refused[clip.source]
            yield variation, solution


def variation_key(source: str, body: str) -> str:
    """Return the key of a variation in the cache."""
    return f"{source}/{body}"


def write_dataset(
    folder: Path, dataset: SourceDataset, augmentation: Augmentation
) -> list[VariationRecord]:
    """Write sources and variations, a file for each clip, and their records."""
    rows, pending = _copy_cached_clips(folder, dataset, augmentation)
    n_new = sum(len(clip.variations) for clip in pending)
    LOG.info("%s: %d planned, %d of them new", dataset.name, len(rows) + n_new, n_new)
    for clip, state in _solve_pending(dataset, pending, augmentation):
        source = dataset.read(clip.clip)
        outcomes = state.outcomes(clip, augmentation.variations)
        new = write_clip_files(folder, clip.clip, source, outcomes, augmentation.limits)
        augmentation.clips.put(clip.key, new.to_entry())
        rows += new.rows
    rows.sort(key=lambda row: row.variation)
    names = [segment.name for segment in segments(dataset.read(min(dataset.clips)).skeleton)]
    write_variations(folder / VARIATIONS, rows, names)
    write_rows(folder / CLIPS, ClipRecord, list(dataset.clips.values()))
    return rows


def _copy_cached_clips(
    folder: Path, dataset: SourceDataset, augmentation: Augmentation
) -> tuple[list[VariationRecord], list[PendingClip]]:
    """Copy the files of cached clips while further clips are read; plan the other clips."""
    copies = []
    with ThreadPoolExecutor(N_COPY_THREADS) as pool:
        for clip in dataset.clips:
            source = dataset.read(clip)
            source_hash = source_key(source)
            key = clip_key(clip, source_hash, source)
            copies.append(
                (clip, key, source_hash, pool.submit(_copy, augmentation.clips, key, folder, clip))
            )
    rows, pending = list[VariationRecord](), []
    for clip, key, source_hash, future in copies:
        records = future.result()
        if records is None:
            pending.append(
                PendingClip(clip, key, source_hash, _plan_clip(clip, dataset, augmentation.plan))
            )
        else:
            rows += records
    return rows, pending


def _copy(cache: Cache, key: str, folder: Path, clip: str) -> list[VariationRecord] | None:
    """Write the cached files of a clip and return its records; None if it is not cached."""
    entry = cache.get(key)
    if entry is None:
        return None
    files = ClipFiles.from_entry(entry)
    files.write(folder, clip)
    return files.rows


def _plan_clip(clip: str, dataset: SourceDataset, plan: Plan) -> list[tuple[str, Variation]]:
    """Plan a clip's variations, each with the hash of its bodies and solution."""
    source = dataset.read(clip)
    bodies = (
        measure_body(source.person_a, source.skeleton),
        measure_body(source.person_b, source.skeleton),
    )
    return [
        (body_key(variation.scales, variation.solution), variation)
        for variation in plan_variations(plan, bodies, clip)
    ]


def _solve_pending(
    dataset: SourceDataset, pending: Sequence[PendingClip], augmentation: Augmentation
) -> Iterator[tuple[PendingClip, CacheState]]:
    """Solve for the variations that are not cached, in batches; yield each completed clip."""
    state = CacheState()
    keys = {variation_key(clip.source, body) for clip in pending for body, _ in clip.variations}
    state.cached.update(key for key in sorted(keys) if augmentation.variations.get(key))
    batches = list(_make_batches(dataset, pending, state, augmentation.solver))
    n_bodies, n_done = sum(len(batch.body_keys) for batch in batches), 0
    pending_of_source: dict[str, list[PendingClip]] = {}
    for clip in pending:
        if state.missing(clip):
            pending_of_source.setdefault(clip.source, []).append(clip)
        else:
            yield clip, state
    for outcome in _solve_batches(batches):
        _store_outcome(outcome, state, augmentation.variations)
        n_done += len(outcome.variations)
        LOG.info("%s: %d of %d solved", dataset.name, n_done, n_bodies)
        clips = pending_of_source.get(outcome.source_key, [])
        if not any(state.missing(clip) for clip in clips):
            pending_of_source.pop(outcome.source_key, None)
            yield from ((clip, state) for clip in clips)


def _store_outcome(outcome: BatchResult, state: CacheState, cache: Cache) -> None:
    """Add the variations of a batch to the cache."""
    if outcome.error:
        state.refused[outcome.source_key] = outcome.error
    for body, solution in outcome.variations.items():
        cache.put(variation_key(outcome.source_key, body), variation_to_entry(solution))
        state.cached.add(variation_key(outcome.source_key, body))


def _solve_batches(batches: list[Batch]) -> Iterator[BatchResult]:
    address = scheduler_address()
    if address:
        return solve_on_cluster(batches, address)
    return solve_with_processes(batches, processes=os.cpu_count() or 1)


def _make_batches(
    dataset: SourceDataset, pending: Sequence[PendingClip], state: CacheState, settings: Settings
) -> Iterator[Batch]:
    """Yield the missing bodies of each source and solution in batches of the solver."""
    sources: dict[str, dict[str, Variation]] = {}
    clips: dict[str, str] = {}
    for clip in pending:
        if missing_bodies := state.missing(clip):
            sources.setdefault(clip.source, {}).update(missing_bodies)
            clips.setdefault(clip.source, clip.clip)
    for key, bodies in sources.items():
        source = dataset.read(clips[key])
        by_solution: dict[Solution, list[str]] = {}
        for name, variation in bodies.items():
            by_solution.setdefault(variation.solution, []).append(name)
        for solution, names in by_solution.items():
            weighted = solution.apply(settings)
            for first in range(0, len(names), MAX_BATCH):
                body_keys = tuple(names[first : first + MAX_BATCH])
                scales = np.stack([np.concatenate(bodies[name].scales) for name in body_keys])
                yield Batch(key, solver_key(weighted), source, weighted, scales, body_keys)


# Folders of the cache.
VARIATION_CACHE, CLIP_CACHE = "variations", "clips"
PERCENTILES = (5, 95)  # of the measurements that are reported


@dataclass(frozen=True)
class Params:
    """The ``augment`` section of ``params.yaml``."""

    clips: ClipSelection
    second_dataset: SecondDataset
    plan: Plan  # target bodies of each clip
    solver: Settings
    limits: VariationLimits  # of a variation that is accepted for training


def main(paths: argparse.Namespace) -> None:
    params = read_params("augment", Params)
    solver_hash = solver_key(params.solver)
    variations = Cache(paths.cache / VARIATION_CACHE, solver_hash)
    clips = Cache(paths.cache / CLIP_CACHE, settings_key(solver_hash, params.plan, params.limits))
    augmentation = Augmentation(params.plan, params.solver, params.limits, variations, clips)
    datasets = [
        main_dataset(paths.clips, params.clips),
        *second_dataset(params.second_dataset, paths.second, params.clips),
    ]
    if paths.variations.exists():
        # As DVC does before it runs a stage: a killed run may have left files.
        shutil.rmtree(paths.variations)
    metrics = {}
    for dataset in datasets:
        rows = write_dataset(paths.variations / dataset.name, dataset, augmentation)
        write_json(paths.variations / dataset.name / SOLVER, asdict(params.solver))
        metrics[dataset.name] = summary(rows, params.limits)
    variations.remove_other_namespaces()
    clips.remove_other_namespaces()
    clips.remove_unused()
    write_json(paths.metrics, metrics)


def summary(rows: Sequence[VariationRecord], limits: VariationLimits) -> dict[str, object]:
    """Count variations, accepted and not, with reasons; summarise measurements by kind."""
    refused = [row for row in rows if not row.accepted and not row.measurements]
    failed = [row for row in rows if not row.accepted and row.measurements]
    reasons = Counter(name for row in failed for name in exceeded_limits(row.measurements, limits))
    kinds = sorted({row.kind for row in rows if row.measurements})
    return {
        "clips": len({row.clip for row in rows}),
        "planned": len(rows),
        "accepted": sum(row.accepted for row in rows),
        "failed": len(failed),
        "refused": len(refused),
        "failed_by": dict(sorted(reasons.items())),
        "refused_clips": sorted({row.clip for row in refused}),
        "kinds": {kind: statistics([row for row in rows if row.kind == kind]) for kind in kinds},
    }


def statistics(rows: Sequence[VariationRecord]) -> dict[str, dict[str, float]]:
    """Return the mean and the percentiles of each measurement."""
    result = {}
    for name in sorted({name for row in rows for name in row.measurements}):
        values = [row.measurements[name] for row in rows if name in row.measurements]
        values = [value for value in values if isfinite(value)]
        if values:
            low, high = np.percentile(values, PERCENTILES)
            result[name] = {"mean": float(np.mean(values)), "low": float(low), "high": float(high)}
    return result


def arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--cache", type=Path, required=True, help="folder of the cache")
    for name in ("clips", "second", "variations", "metrics"):
        parser.add_argument(name, type=Path)
    return parser.parse_args()


if __name__ == "__main__":
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    run_stage(main, arguments())
