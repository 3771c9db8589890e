"""The clips that the page plays: best, median and worst reaction, then one of each action."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.names import ReactionName, direction_of, split_variation_name
from pacmo_core.figures.numbers import format_number
from pacmo_core.figures.report import Section
from pacmo_core.figures.variations import (
    ShownVariation,
    measure_label,
    played_variation,
    variation_label,
    variation_table,
    worst_by_measure,
)
from pacmo_core.figures.viewer import Panel, PlayedClip
from pacmo_core.metrics.catalogue import ROWS
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
                Panel("Captured", clips[name][1]),
                *(
                    Panel(row_label(row), result[name])
                    for row, result in reactions_by_row.items()
                    if name in result
                ),
            ),
            remarks.get(name, ""),
        )
        for name in first[:n_clips]
    ]


def row_label(row: str) -> str:
    """Return the label of a row of the tables."""
    return ROWS.get(row, (row, ""))[0]


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
            f"{word} of {len(order):,} reactions of person b by {row_label(RANKED)}: joints "
            f"{format_number(errors[name])} m from the captured reaction on average, which is one "
            "of many plausible ones.",
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
            f"{facts['planned']:,} variations of {facts['clips']:,} clips: "
            f"{facts['accepted']:,} accepted, "
            f"{facts['failed']:,} beyond a limit, {facts['refused']:,} of refused clips."
        )
        by = sorted(facts["failed_by"].items(), key=lambda item: (-item[1], item[0]))
        reasons = ", ".join(f"{measure_label(name)} ({number:,})" for name, number in by)
        beyond = (f"Beyond a limit, and left out of training, by: {reasons}.",) if reasons else ()
        usual = "Small figures: the 5th and the 95th percentile."
        title = f"Variations of {dataset}: the same interaction on other bodies"
        yield Section(title, variation_table(facts["kinds"]), (counts, *beyond, usual))


def gallery(variations: Path, n_each: int, limits: Mapping[str, float]) -> Iterator[PlayedClip]:
    """Yield clips beside those of their variations that are the worst by a measurement.

    Parameters
    ----------
    n_each : variations beside their source, at most; further ones are in a further clip
    limits : by measurement, of a variation that is accepted
    """
    for folder in sorted(path for path in variations.iterdir() if path.is_dir()):
        rows = {
            row.variation: row for row in read_variations(folder / VARIATIONS) if row.measurements
        }
        worst = worst_by_measure((name, row.measurements) for name, row in rows.items())
        by_clip: dict[str, list[str]] = {}
        for name in worst:
            by_clip.setdefault(rows[name].clip, []).append(name)
        for clip, names in by_clip.items():
            for start in range(0, len(names), n_each):
                shown = [
                    shown_variation(folder, rows[name], worst[name])
                    for name in names[start : start + n_each]
                ]
                source = read_motion(motion_file(folder / SOURCES, clip), clip)
                yield played_variation(f"{folder.name}, {clip}", source, shown, limits)


def shown_variation(folder: Path, row: VariationRecord, worst_by: list[str]) -> ShownVariation:
    """Read the motion of a variation, and the measurements for which it is left out, if it is."""
    file = motion_file(folder / (ACCEPTED if row.accepted else FAILED), row.clip)
    return ShownVariation(
        variation_label(split_variation_name(row.variation)[1]),
        row.measurements,
        read_motion(file, row.variation),
        worst_by,
        [part.split()[0] for part in row.reason.split("; ")] if row.reason else [],
    )
