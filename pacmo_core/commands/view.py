"""``pacmo view``: clips of the store or captures of any format, played in a page."""

import webbrowser
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from pacmo_core.commands.captures import names_clips
from pacmo_core.data.names import ReactionName, is_reaction
from pacmo_core.figures.viewer import MAX_CLIPS, Scene, render_viewer
from pacmo_core.formats.base import FormatError, RawSequence, read_capture
from pacmo_core.formats.registry import (
    DEFAULT_SETTINGS,
    ONE_PERSON_FORMATS,
    PersonMotion,
    format_of,
    open_format,
    read_partner,
    read_single,
)
from pacmo_core.project.workspace import MOTIONS, CommandError, reading_errors_in_one_line
from pacmo_core.store.files import write_text
from pacmo_core.store.motions import motion_file, read_motion
from pacmo_core.store.tables import ACCEPTED, FAILED, SOURCES, VARIATIONS, read_variations

CLIPS_FOLDER = Path("data/clips")


def read_scene(
    word: str, form: str | None, settings: Mapping[str, Any], *, mixed: bool = False
) -> Scene:
    """Read the clip that an argument of the command line names.

    Parameters
    ----------
    word : ``NAME`` of a clip in ``data/clips``, ``STORE:NAME`` of one in another folder or file
        (a variation's name is ``CLIP~NAME``), ``FILE`` of a capture, or ``FILE+FILE`` of two people
    form : format of captures; None to infer it from their suffixes
    settings : overrides of the default settings of the format
    mixed : captures of several formats are read: each takes the settings that its format has

    Raises
    ------
    CommandError
        If there is no such clip, or the argument is ambiguous.
    FormatError, StoreError, KeyError, ValueError
        If the clip cannot be read.
    """
    store, colon, name = word.partition(":")
    if colon and Path(store).exists():
        return _read_stored(Path(store), name)
    files = [Path(part) for part in word.split("+")]
    if all(file.is_file() for file in files):
        return _read_captures(files, form, settings, mixed=mixed)
    if (CLIPS_FOLDER / MOTIONS).exists() and len(files) == 1:
        return _read_stored(CLIPS_FOLDER, word)
    raise CommandError(
        f"{word}: no such file, and no {CLIPS_FOLDER / MOTIONS} with a clip of that name; "
        "a clip of another folder is FOLDER:NAME"
    )


def _read_stored(store: Path, name: str) -> Scene:
    """Read a clip of the store; the colour of a person does not depend on who reacts."""
    if not name:
        raise CommandError(f"{store}: wanted the name of a clip after the colon (pacmo clips)")
    clip = read_motion(_file_of(store, name) if store.is_dir() else store, name)
    # The folder distinguishes reactions to the same partner, such as pacmo/1.
    folder = "/".join(store.parts[-2:]) if is_reaction(name) and store.is_dir() else ""
    label = f"{folder} · {name}" if folder else name
    swap = is_reaction(name) and ReactionName.parse(name).direction == "a"
    return Scene.of(label, clip.swapped() if swap else clip)


def _file_of(folder: Path, name: str) -> Path:
    """Return the file of a folder that has a clip; variations have one file for each source."""
    table = folder / VARIATIONS
    if not table.exists():
        return folder / MOTIONS
    rows = [row for row in read_variations(table) if name in (row.variation, row.clip)]
    if not rows:
        raise CommandError(f"{table}: no variation and no source named {name}")
    row = rows[0]
    if name == row.clip:
        return motion_file(folder / SOURCES, row.clip)
    if not row.measurements:
        raise CommandError(f"{table}: {name} has no motion: {row.reason}")
    return motion_file(folder / (ACCEPTED if row.accepted else FAILED), row.clip)


def _read_captures(
    files: list[Path], form: str | None, settings: Mapping[str, Any], *, mixed: bool
) -> Scene:
    if any(names_clips(file, "") for file in files):
        raise CommandError(f"{files[0]}: name the clip, {files[0]}:NAME")
    forms = [form or format_of(file) for file in files]
    for name in forms:
        if name not in DEFAULT_SETTINGS:
            raise CommandError(f"no format {name!r}; there are {', '.join(DEFAULT_SETTINGS)}")
    pairs = all(name in ONE_PERSON_FORMATS for name in forms)
    if len(files) > (2 if pairs else 1):
        raise CommandError(f"{files[0]}: wanted {'at most two files' if pairs else 'one file'}")
    label = " + ".join(file.stem for file in files)
    own = [
        {option: settings[option] for option in settings if option in DEFAULT_SETTINGS[name]}
        if mixed or len(set(forms)) > 1
        else settings
        for name in forms
    ]
    if pairs:
        people = [
            read_partner(file, name, options, person=None, clip="")
            for file, name, options in zip(files, forms, own, strict=True)
        ]
        return _scene_of_people(label, files, people)
    opened = open_format(forms[0], {**DEFAULT_SETTINGS[forms[0]], **own[0]})
    if single := read_single(files[0], opened):
        return Scene(label, single.skeleton, single.times, (single.motion,))
    both = RawSequence(files[0].stem, (files[0],))
    return Scene.of(label, read_capture(opened, both).interaction)


def _scene_of_people(label: str, files: Sequence[Path], people: Sequence[PersonMotion]) -> Scene:
    """Join one or two people, whose skeletons may differ, on one clock.

    Raises
    ------
    FormatError
        If their frames are not at the same times.
    """
    first, last = people[0], people[-1]
    if len(first.times) != len(last.times):
        reason = f"{len(last.times)} frames; {files[0].name} has {len(first.times)}"
        raise FormatError(files[-1], reason)
    if not np.allclose(first.times, last.times, rtol=1e-4):
        ends = f"ends at {last.times[-1]:g} s; {files[0].name} at {first.times[-1]:g} s"
        raise FormatError(files[-1], ends)
    other = last.skeleton if last.skeleton != first.skeleton else None
    motions = tuple(person.motion for person in people)
    return Scene(label, first.skeleton, first.times, motions, other)


def _are_mixed(words: Sequence[str], form: str | None, options: Iterable[str]) -> bool:
    """Return whether the captures among the arguments are of several formats.

    Raises
    ------
    CommandError
        If an option applies to none of several formats.
    """
    files = [Path(part) for word in words for part in word.split("+")]
    captures = [file for file in files if file.is_file() and not names_clips(file, "")]
    formats = {form or format_of(file) for file in captures}
    if len(formats) < 2:
        return False
    for option in options:
        if not any(option in DEFAULT_SETTINGS[name] for name in formats):
            raise CommandError(f"--{option} applies to none of {', '.join(sorted(formats))}")
    return True


def _distinct_labels(scenes: Sequence[Scene], words: Sequence[str]) -> list[Scene]:
    """Name scenes of equal labels by their folders too, and by their number if that is equal."""
    counts = Counter(scene.label for scene in scenes)
    folders = [Path(word.split("+")[0].partition(":")[0]).parent.name for word in words]
    named = [
        f"{folder}/{scene.label}" if counts[scene.label] > 1 and folder else scene.label
        for scene, folder in zip(scenes, folders, strict=True)
    ]
    again = Counter(named)
    return [
        replace(scene, label=f"{label} ({number})" if again[label] > 1 else label)
        for number, (scene, label) in enumerate(zip(scenes, named, strict=True), start=1)
    ]


def _with_labels(scenes: Sequence[Scene], words: Sequence[str], labels: list[str]) -> list[Scene]:
    if not labels:
        return _distinct_labels(scenes, words)
    if len(labels) != len(scenes):
        raise CommandError(f"wanted a --label for each of {len(scenes)} clips; got {len(labels)}")
    return [replace(scene, label=label) for scene, label in zip(scenes, labels, strict=True)]


Clips = Annotated[
    list[str], typer.Argument(metavar="CLIP...", help="NAME, FOLDER:NAME, FILE or FILE+FILE")
]
Out = Annotated[Path, typer.Option(help="the HTML file to write")]
Contact = Annotated[
    float,
    typer.Option(min=0, help="distance in metres below which joints are marked as in contact"),
]
Labels = Annotated[
    list[str], typer.Option("--label", help="name of a clip on the page, one for each in order")
]
Open = Annotated[bool, typer.Option("--open/--no-open", help="open it in the browser")]
FormatName = Annotated[
    str | None, typer.Option("--format", help="format of captures; default: by the suffix")
]
Preset = Annotated[str | None, typer.Option(help="preset of BVH files: duo_mocap, cmu_18_19, ...")]
Unit = Annotated[float | None, typer.Option(help="metres per unit of a BVH file")]
Up = Annotated[str | None, typer.Option(help="up axis of the captures, y or z")]
CaptureFps = Annotated[
    float | None,
    typer.Option("--fps", help="frame rate of a capture, if it states none or a wrong one"),
]


def view(  # noqa: PLR0913  # typer reads the options off the signature
    clips: Clips,
    out: Out = Path("view.html"),
    contact: Contact = 0.1,
    open_it: Open = True,
    label: Labels = [],  # noqa: B006  # typer copies it
    form: FormatName = None,
    preset: Preset = None,
    unit: Unit = None,
    up: Up = None,
    fps: CaptureFps = None,
) -> None:
    """Play clips side by side in 3-D, in one HTML page.

    pacmo view S001C001P001R001A050

    pacmo view NAME data/reactions/1/pacmo/1:NAME#b#0

    pacmo view walk_A.bvh+walk_B.bvh --unit 0.01 --up y

    pacmo view x_A.bvh+x_B.bvh new/x_A.bvh+new/x_B.bvh --preset pair --label before --label after

    A CLIP is the name of a clip in data/clips, FOLDER:NAME or FILE.parquet:NAME elsewhere, the FILE
    of a capture, or FILE+FILE if each person has a file. Up to six clips play at the same time,
    whatever their frame rates. The page is one file and needs neither network nor server.
    """
    options = {"preset": preset, "unit": unit, "up": up, "fps": fps}
    settings = {name: value for name, value in options.items() if value is not None}
    with reading_errors_in_one_line():
        if len(clips) > MAX_CLIPS:
            raise CommandError(f"wanted at most {MAX_CLIPS} clips side by side; got {len(clips)}")
        mixed = _are_mixed(clips, form, settings)
        read = [read_scene(word, form, settings, mixed=mixed) for word in clips]
        scenes = _with_labels(read, clips, label)
        write_text(out, render_viewer(scenes, contact=contact))
    typer.echo(f"{out}: {len(scenes)} {'clip' if len(scenes) == 1 else 'clips'}")
    if open_it:
        webbrowser.open(out.resolve().as_uri())
