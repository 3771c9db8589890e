"""Make what is planned and not yet kept, and put it into files.

A variation's name is its clip's, ``~`` and what it is; ``~`` sorts after every character of a
clip's name.
"""

import logging
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import inf
from pathlib import Path

import numpy as np

from pacmo_core.interaction import Interaction
from pacmo_core.interaction_mesh import BATCH, Settings
from pacmo_core.skeleton import Skeleton
from pacmo_core.store.clips import ClipFacts, write_rows
from pacmo_core.store.kept import Kept, read_kept
from pacmo_core.store.motions import write_motions
from pacmo_core.store.variations import (
    FAILED,
    SOURCES,
    VARIATIONS,
    VariationFacts,
    write_variations,
)
from pacmo_core.variations.bodies import body_of
from pacmo_core.variations.keep import Bounds, reason_of, worst
from pacmo_core.variations.keys import body_key, maker_key, source_key
from pacmo_core.variations.plan import SEPARATOR, Plan, Variation, plan_variations
from pacmo_core.variations.segments import segments
from pacmo_core.variations.solve import Lot, Outcome
from pacmo_core.variations.workers import solve_on_cluster, solve_side_by_side
from stages._cluster import scheduler_address
from stages._files import CLIPS, MOTIONS
from stages._sources import Family

LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class Planned:
    """One variation of one clip, and the hashes under which it is kept."""

    clip: str
    variation: Variation
    source: str
    body: str

    @property
    def name(self) -> str:
        """Give the name that it has in the file."""
        return f"{self.clip}{SEPARATOR}{self.variation.name}"


@dataclass(frozen=True)
class Found:
    """Where variations stand, by source and body; and why sources were refused."""

    files: dict[tuple[str, str], Path]
    refused: dict[str, str]


def plan_family(family: Family, plan: Plan) -> list[Planned]:
    """Plan the variations of every clip."""
    planned: list[Planned] = []
    for clip in family.clips:
        source = family.read(clip)
        key = source_key(source)
        bodies = (
            body_of(source.person_a, source.skeleton),
            body_of(source.person_b, source.skeleton),
        )
        planned += [
            Planned(clip, variation, key, body_key(variation.scales))
            for variation in plan_variations(plan, bodies, clip)
        ]
    return planned


def make(family: Family, planned: Sequence[Planned], settings: Settings, kept: Kept) -> Found:
    """Make what is not kept yet, and keep each lot as it is done."""
    files = {
        (source, body): path
        for source in dict.fromkeys(one.source for one in planned)
        for body, path in kept.find(source).items()
    }
    new = [one for one in planned if (one.source, one.body) not in files]
    LOG.info("%s: %d planned, %d to make", family.name, len(planned), len(new))
    refused, n_done = {}, 0
    for outcome in _solved(list(_lots(family, new, settings))):
        if outcome.refused:
            refused[outcome.key] = outcome.refused
        for body, path in kept.write(outcome.key, outcome.made).items():
            files[outcome.key, body] = path
        n_done += len(outcome.made)
        LOG.info("%s: %d of %d made", family.name, n_done, len(new))
    return Found(files, refused)


def write_family(
    folder: Path, family: Family, planned: Sequence[Planned], found: Found, bounds: Bounds
) -> list[VariationFacts]:
    """Write motions that are within bounds, those that are not, and the facts of all."""
    skeleton = family.read(next(iter(family.clips))).skeleton
    rows = []
    _write_sources(folder, family, skeleton)
    with (
        write_motions(folder / MOTIONS, skeleton) as good,
        write_motions(folder / FAILED, skeleton) as failed,
    ):
        for one in sorted(planned, key=lambda one: one.name):
            path = found.files.get((one.source, one.body))
            if path is None:
                reason = f"refused: {found.refused[one.source]}"
                rows.append(_facts(one, skeleton, reason, {}, bounds))
                continue
            made = read_kept(path, one.body)
            source = family.read(one.clip)
            motion = Interaction(skeleton, source.times, *made.motions)
            reason = reason_of(made.figures, bounds)
            (failed if reason else good).add(one.name, motion)
            rows.append(_facts(one, skeleton, reason, made.figures, bounds))
    write_variations(folder / VARIATIONS, rows, [s.name for s in segments(skeleton)])
    return rows


def _solved(lots: list[Lot]) -> Iterator[Outcome]:
    address = scheduler_address()
    if address:
        return solve_on_cluster(lots, address)
    return solve_side_by_side(lots, processes=os.cpu_count() or 1)


def _lots(family: Family, new: Sequence[Planned], settings: Settings) -> Iterator[Lot]:
    """Gather what one source lacks, a batch of the solver at a time."""
    sources: dict[str, dict[str, Planned]] = {}
    for one in new:
        sources.setdefault(one.source, {})[one.body] = one
    for key, bodies in sources.items():
        waiting = list(bodies.values())
        for first in range(0, len(waiting), BATCH):
            batch = waiting[first : first + BATCH]
            scales = np.stack([np.concatenate(one.variation.scales) for one in batch])
            source = family.read(batch[0].clip)
            names = tuple(one.body for one in batch)
            yield Lot(key, maker_key(settings), source, settings, scales, names)


def _write_sources(folder: Path, family: Family, skeleton: Skeleton) -> None:
    """Write the clips that are varied, beside what comes of them."""
    with write_motions(folder / SOURCES, skeleton) as writer:
        for name in family.clips:
            writer.add(name, family.read(name))
    write_rows(folder / CLIPS, ClipFacts, list(family.clips.values()))


def _facts(
    one: Planned, skeleton: Skeleton, reason: str, figures: dict[str, float], bounds: Bounds
) -> VariationFacts:
    names = [segment.name for segment in segments(skeleton)]
    a, b = (dict(zip(names, own.tolist(), strict=True)) for own in one.variation.scales)
    return VariationFacts(
        variation=one.name,
        clip=one.clip,
        kind=one.variation.kind,
        kept=not reason,
        reason=reason,
        badness=worst(figures, bounds) if figures else inf,
        figures=figures,
        scales_a=a,
        scales_b=b,
    )
