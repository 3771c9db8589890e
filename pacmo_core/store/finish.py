"""What comes of a clip, as it stands in the files: motions within bounds, those beyond, facts."""

import hashlib
import json
from collections.abc import Iterable
from dataclasses import asdict
from math import inf
from pathlib import Path

from pacmo_core.augmentation.keep import Bounds, reason_of, worst
from pacmo_core.augmentation.keys import LENGTH, code_key
from pacmo_core.augmentation.plan import Plan, Variation
from pacmo_core.augmentation.segments import segments
from pacmo_core.augmentation.solve import Made
from pacmo_core.data.interaction import Interaction
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.store.finished import FinishedClip
from pacmo_core.store.motion_folders import SEPARATOR, file_of
from pacmo_core.store.motions import write_motions
from pacmo_core.store.variations import FAILED, GOOD, SOURCES, VariationFacts

# What stands in the files rests on this beside what makes variations.
CODE = ("interaction.py", "skeleton.py", "store/*.py", "variations/*.py")
PACKAGES = ("numpy", "pyarrow")


def finisher_key(maker: str, plan: Plan, bounds: Bounds) -> str:
    """Hash all that finished clips rest on, themselves apart.

    Parameters
    ----------
    maker : the hash of what makes variations
    """
    text = json.dumps([maker, asdict(plan), asdict(bounds), code_key(CODE, PACKAGES)])
    return hashlib.sha256(text.encode()).hexdigest()[:LENGTH]


def clip_key(finisher: str, clip: str, source: str, interaction: Interaction) -> str:
    """Hash one clip with its finisher: its name, the key of what it shows, and what that omits."""
    facts = json.dumps([finisher, clip, source, interaction.skeleton.name])
    digest = hashlib.sha256(facts.encode())
    digest.update(interaction.times.astype("<f8").tobytes())
    return digest.hexdigest()[:LENGTH]


def finish(
    family: Path,
    clip: str,
    source: Interaction,
    made: Iterable[tuple[Variation, Made | str]],
    bounds: Bounds,
) -> FinishedClip:
    """Write what came of a clip into its family's folder.

    Parameters
    ----------
    made : its variations by ascending name, each with its motion, or why the clip was refused
    """
    rows = []
    motions: dict[str, dict[str, Interaction]] = {SOURCES: {clip: source}, GOOD: {}, FAILED: {}}
    for variation, outcome in made:
        row = facts_of(clip, variation, outcome, source.skeleton, bounds)
        rows.append(row)
        if isinstance(outcome, Made):
            varied = Interaction(source.skeleton, source.times, *outcome.motions)
            motions[GOOD if row.kept else FAILED][row.variation] = varied
    files = {}
    for folder, held in motions.items():
        if held:
            path = file_of(family / folder, clip)
            with write_motions(path, source.skeleton) as writer:
                for name, motion in held.items():
                    writer.add(name, motion)
            files[folder] = path.read_bytes()
    return FinishedClip(rows, files)


def facts_of(
    clip: str, variation: Variation, outcome: Made | str, skeleton: Skeleton, bounds: Bounds
) -> VariationFacts:
    """Say what a variation is, and whether it is kept."""
    refused = isinstance(outcome, str)
    figures = {} if isinstance(outcome, str) else outcome.figures
    reason = f"refused: {outcome}" if refused else reason_of(figures, bounds)
    names = [segment.name for segment in segments(skeleton)]
    a, b = (dict(zip(names, own.tolist(), strict=True)) for own in variation.scales)
    return VariationFacts(
        variation=f"{clip}{SEPARATOR}{variation.name}",
        clip=clip,
        kind=variation.kind,
        kept=not reason,
        reason=reason,
        badness=worst(figures, bounds) if figures else inf,
        figures=figures,
        scales_a=a,
        scales_b=b,
    )
