"""The clips that the page plays: best, median and worst reaction, then one of each action."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.names import ReactionName, direction_of, split_variation_name
from pacmo_core.figures.clips import Panel, PlayedClip, played_variation, variation_table
from pacmo_core.figures.report import Section
from pacmo_core.store.motions import motion_file, read_motion, stream_motions
from pacmo_core.store.tables import (
    ACCEPTED,
    FAILED,
    SOURCES,
    VARIATIONS,
    VariationRecord,
    read_variations,
)
from stages.common.clips import directed_clips
from stages.common.files import MOTIONS

RANKED = "pacmo"  # the model whose errors rank the clips


def played(
    folders: tuple[Path, Path], reactions: dict[str, Path], n_clips: int
) -> list[PlayedClip]:
    """Select test clips, with the reaction of each row beside the captured one."""
    clips = {
        name: (facts.action, interaction)
        for name, facts, interaction in directed_clips(*folders, "test")
        if direction_of(name) == "b"
    }
    reactions_by_row = {row: read_first_reactions(folder) for row, folder in reactions.items()}
    ranked_reactions = reactions_by_row.get(RANKED, {})
    errors = {
        n: error(interaction, ranked_reactions[n])
        for n, (_, interaction) in clips.items()
        if n in ranked_reactions
    }
    remarks = extremes(errors)
    first = list(remarks) + [name for name in alternate_actions(clips) if name not in remarks]
    return [
        PlayedClip(
            name,
            clips[name][0],
            (
                Panel("real", clips[name][1]),
                *(
                    Panel(row, result[name])
                    for row, result in reactions_by_row.items()
                    if name in result
                ),
            ),
            remarks.get(name, ""),
        )
        for name in first[:n_clips]
    ]


def error(captured: Interaction, generated: Interaction) -> float:
    """Return the mean distance of joints between two reactions, metres."""
    distance = np.linalg.norm(captured.person_b - generated.person_b, axis=-1)
    return float(distance.mean(dtype=np.float64))


def extremes(errors: dict[str, float]) -> dict[str, str]:
    """Return a remark on the clips with the smallest, the median and the largest error."""
    order = sorted(errors, key=lambda name: (errors[name], name))
    if not order:
        return {}
    indices = {"Best": 0, "Median": (len(order) - 1) // 2, "Worst": len(order) - 1}
    remarks: dict[str, str] = {}
    for word, index in indices.items():
        name = order[index]
        remarks.setdefault(
            name,
            f"{word} of {len(order)} reactions of {RANKED}: joints {errors[name]:.3f} m from the "
            "captured reaction on average, which is one of many plausible ones.",
        )
    return remarks


def alternate_actions(clips: dict[str, tuple[str, Interaction]]) -> Iterator[str]:
    """Yield clip names: one of each action, then a second of each, and so on."""
    rank: dict[str, int] = {}
    order = []
    for name, (action, _) in clips.items():
        rank[action] = rank.get(action, -1) + 1
        order.append((rank[action], name))
    yield from (name for _, name in sorted(order))


def read_first_reactions(folder: Path) -> dict[str, Interaction]:
    """Read the first sample of each reaction of one row, by clip and direction."""
    result = ((ReactionName.parse(name), i) for name, i in stream_motions(folder / MOTIONS))
    return {name.directed: interaction for name, interaction in result if name.sample == 0}


def variation_sections(augment: dict[str, Any]) -> Iterator[Section]:
    """Yield a table of measurements for each dataset of variations."""
    for dataset, facts in augment.items():
        counts = (
            f"{facts['planned']} variations of {facts['clips']} clips: "
            f"{facts['accepted']} accepted, "
            f"{facts['failed']} beyond a limit, {facts['refused']} of refused clips."
        )
        reasons = ", ".join(f"{name} {count}" for name, count in facts["failed_by"].items())
        beyond = (f"Beyond a limit, and left out of training: {reasons}.",) if reasons else ()
        usual = "Small figures: the 5th and the 95th percentile."
        title = f"Variations of {dataset}: the same interaction on other bodies"
        yield Section(title, variation_table(facts["kinds"]), (counts, *beyond, usual))


def gallery(variations: Path, n_clips: int, n_each: int) -> Iterator[PlayedClip]:
    """Yield clips beside their worst variations, the clip with the worst of all first."""
    for folder in sorted(path for path in variations.iterdir() if path.is_dir()):
        rows = [row for row in read_variations(folder / VARIATIONS) if row.measurements]
        worst = sorted(rows, key=lambda row: (-row.limit_ratio, row.variation))
        for clip in list(dict.fromkeys(row.clip for row in worst))[:n_clips]:
            rows_of_clip = [row for row in worst if row.clip == clip][:n_each]
            yield _shown(folder, clip, rows_of_clip)


def _shown(folder: Path, clip: str, rows: list[VariationRecord]) -> PlayedClip:
    panels = []
    for row in rows:
        file = motion_file(folder / (ACCEPTED if row.accepted else FAILED), clip)
        label = split_variation_name(row.variation)[1]
        mark = "" if row.accepted else " (left out)"
        panels.append((f"{label}{mark}", row.measurements, read_motion(file, row.variation)))
    return played_variation(clip, read_motion(motion_file(folder / SOURCES, clip), clip), panels)
