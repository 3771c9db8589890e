"""The page of ``augment`` and ``vary``: a source beside its variations, and what changed."""

from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from pacmo_core.augmentation.filter import VariationLimits, exceeded_limits
from pacmo_core.commands.captures import TwoPersonCapture, is_parquet
from pacmo_core.commands.measured import Measured
from pacmo_core.commands.view import scene_of_people
from pacmo_core.data.names import file_stem
from pacmo_core.figures.variations import limits_table
from pacmo_core.figures.viewer import MAX_CLIPS, Scene, render_viewer
from pacmo_core.formats.registry import PersonMotion
from pacmo_core.store.files import write_text

# What a page plays of a long capture: more would be slow to open.
MAX_FPS, MAX_FRAMES = 60.0, 3600


def write_variation_page(
    duo: TwoPersonCapture,
    variations: Sequence[tuple[PersonMotion, PersonMotion]],
    measured: Measured,
    limits: VariationLimits,
    out: Path,
) -> Path:
    """Write the page beside the written files.

    Parameters
    ----------
    duo : the capture
    variations : the two people of each, as they are in the files; the page has the first ones
    measured : their measurements
    limits : of what looks natural
    out : of the command: a file or a folder

    Returns
    -------
    its path: FILE.html beside FILE.bvh and FILE.parquet, NAME.html in a folder
    """
    in_folder = not is_parquet(out) and out.suffix.lower() != ".bvh"
    page = out / f"{file_stem(duo.name)}.html" if in_folder else out.with_suffix(".html")
    labels = [f"variation {number}" for number in range(min(len(variations), MAX_CLIPS - 1))]
    labels = labels if len(variations) > 1 else ["variation"]
    shown_people = zip(labels, variations, strict=False)
    scenes = [_scene("source", duo.people), *(_scene(*shown) for shown in shown_people)]
    columns = [
        (label, figures, set(exceeded_limits(figures, limits)))
        for label, figures in zip(labels, measured.samples, strict=False)
    ]
    table = limits_table(columns, asdict(limits))
    shown = _shown_frames(duo.people[0])
    n_frames = len(duo.people[0].times)
    played = "" if n_frames == len(shown) else f", {len(shown):,} of {n_frames:,} frames"
    what = "variation" if len(labels) == 1 else f"{len(labels)} of {len(variations)} variations"
    title = f"{duo.name}: source and {what}{played}"
    write_text(page, render_viewer(scenes, contact=0.1, title=title, table=table))
    return page


def _scene(label: str, people: tuple[PersonMotion, PersonMotion]) -> Scene:
    frames = _shown_frames(people[0])
    times = people[0].times[frames] - people[0].times[0]
    shown = [replace(person, times=times, motion=person.motion[frames]) for person in people]
    return scene_of_people(label, shown)


def _shown_frames(person: PersonMotion) -> list[int]:
    """List the frames that the page plays: at most ``MAX_FPS``, from the start ``MAX_FRAMES``."""
    fps = float(1 / np.median(np.diff(person.times)))
    step = max(1, round(fps / MAX_FPS))
    return list(range(0, len(person.times), step))[:MAX_FRAMES]
