"""The page's part about variations: how many, how good, and the worst of them playing."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pacmo_core.data.names import split_variation_name
from pacmo_core.figures.clips import PlayedClip
from pacmo_core.figures.report import Section
from pacmo_core.figures.variations import variation_table, varied_clip
from pacmo_core.store.motions import motion_file, read_motion
from pacmo_core.store.tables import (
    ACCEPTED,
    FAILED,
    SOURCES,
    VARIATIONS,
    VariationRecord,
    read_variations,
)


def variation_sections(augment: dict[str, Any]) -> Iterator[Section]:
    """Give a table a family."""
    for family, facts in augment.items():
        counts = (
            f"{facts['planned']} variations of {facts['clips']} clips: "
            f"{facts['accepted']} accepted, {facts['failed']} beyond a limit, "
            f"{facts['refused']} of clips that were refused."
        )
        reasons = ", ".join(f"{name} {count}" for name, count in facts["failed_by"].items())
        beyond = (f"Beyond a limit, and left out of training: {reasons}.",) if reasons else ()
        usual = "Small figures: between which values nine of ten variations lie."
        title = f"Variations of {family}: the same interaction on other bodies"
        yield Section(title, variation_table(facts["kinds"]), (counts, *beyond, usual))


def gallery(variations: Path, n_clips: int, n_each: int) -> Iterator[PlayedClip]:
    """Set the worst variations of a clip beside it, the clip with the worst of all first."""
    for folder in sorted(path for path in variations.iterdir() if path.is_dir()):
        rows = [row for row in read_variations(folder / VARIATIONS) if row.measurements]
        worst = sorted(rows, key=lambda row: (-row.limit_ratio, row.variation))
        for clip in list(dict.fromkeys(row.clip for row in worst))[:n_clips]:
            own = [row for row in worst if row.clip == clip][:n_each]
            yield _shown(folder, clip, own)


def _shown(folder: Path, clip: str, rows: list[VariationRecord]) -> PlayedClip:
    shown = []
    for row in rows:
        file = motion_file(folder / (ACCEPTED if row.accepted else FAILED), clip)
        label = split_variation_name(row.variation)[1]
        mark = "" if row.accepted else " (left out)"
        shown.append((f"{label}{mark}", row.measurements, read_motion(file, row.variation)))
    return varied_clip(clip, read_motion(motion_file(folder / SOURCES, clip), clip), shown)
