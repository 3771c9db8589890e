"""The page that ``pacmo augment`` writes: the source beside its variation, and what changed."""

from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from pacmo_core.augmentation.filter import VariationLimits, exceeded_limits
from pacmo_core.commands.captures import TwoPersonCapture, WrittenCapture, is_parquet
from pacmo_core.commands.view import scene_of_people
from pacmo_core.data.names import file_stem
from pacmo_core.figures.variations import limits_table
from pacmo_core.figures.viewer import Scene, render_viewer
from pacmo_core.formats.registry import PersonMotion
from pacmo_core.store.files import write_text

# What a page plays of a long capture: more would be slow to open.
MAX_FPS, MAX_FRAMES = 60.0, 3600


def write_variation_page(
    duo: TwoPersonCapture,
    written: WrittenCapture,
    figures: Mapping[str, float],
    limits: VariationLimits,
    out: Path,
) -> Path:
    """Write the page beside the written files.

    Parameters
    ----------
    duo : the capture
    written : the variation, as it is in the files
    figures : its measurements, by the names of ``interaction_mesh.Report``
    limits : of a variation that is trained on
    out : of the command: a file or a folder

    Returns
    -------
    its path: FILE.html beside FILE.bvh and FILE.parquet, NAME.html in a folder
    """
    in_folder = not is_parquet(out) and out.suffix.lower() != ".bvh"
    page = out / f"{file_stem(duo.name)}.html" if in_folder else out.with_suffix(".html")
    scenes = [_scene("source", duo.people), _scene("variation", written.people)]
    table = limits_table(figures, asdict(limits), exceeded_limits(figures, limits))
    shown = _shown_frames(duo.people[0])
    n_frames = len(duo.people[0].times)
    played = "" if n_frames == len(shown) else f", {len(shown):,} of {n_frames:,} frames"
    title = f"{duo.name}: source and variation{played}"
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
