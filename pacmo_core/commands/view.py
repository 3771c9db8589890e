"""``pacmo view``: clips of the store or captures of any format, played in a page."""

import webbrowser
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import typer

from pacmo_core.commands.captures import (
    check_outputs,
    check_two_people,
    names_clips,
    on_one_clock,
    rate_text,
    read_clip,
    some_clips,
    two_sources,
)
from pacmo_core.commands.reading import (
    FormatName,
    FromFps,
    FromUnit,
    FromUp,
    Preset,
    ReadOptions,
    ReadPerson,
    Source,
    capture_name,
    read_people,
)
from pacmo_core.data.names import ReactionName, is_reaction, is_variation
from pacmo_core.figures.viewer import MAX_CLIPS, Scene, render_viewer
from pacmo_core.formats.registry import ONE_PERSON_FORMATS, PersonMotion, holds_one_person
from pacmo_core.formats.resample import frame_rate
from pacmo_core.project.workspace import (
    MOTIONS,
    VARIATIONS_FOLDER,
    CommandError,
    in_project,
    reading_errors_in_one_line,
)
from pacmo_core.store.files import write_text
from pacmo_core.store.motions import motion_file
from pacmo_core.store.tables import ACCEPTED, FAILED, SOURCES, VARIATIONS, read_variations

CLIPS_FOLDER = in_project(Path("data/clips"))
PAGES = (".html", ".htm")


@dataclass(frozen=True)
class NamedClip:
    """A clip that an argument of the command line names.

    Parameters
    ----------
    scene : the clip
    files : that were read
    sources, read : where its people are, and how they were read; none of a clip of a store
    """

    scene: Scene
    files: Sequence[Path]
    sources: Sequence[Source] = ()
    read: Sequence[ReadPerson] = ()


def read_named_clips(words: Sequence[str], options: ReadOptions) -> list[NamedClip]:
    """Read the clips that the arguments of the command line name (see ``read_named_clip``).

    Raises
    ------
    CommandError
        If an option applies to none of them, or as ``read_named_clip``.
    FormatError, StoreError, KeyError, ValueError
        As ``read_named_clip``.
    """
    files = [file for word in words for file in _files_of(word)]
    captures = [file for file in files if file.is_file() and not names_clips(file, "")]
    of_captures = options.of_captures(captures)
    return [read_named_clip(word, of_captures) for word in words]


def read_named_clip(word: str, options: ReadOptions) -> NamedClip:
    """Read the clip that an argument of the command line names.

    Parameters
    ----------
    word : ``NAME`` of a clip in ``data/clips`` or of a variation (``CLIP~NAME``) in
        ``data/variations``, ``STORE:NAME`` of one in another folder or file, ``FILE`` of a capture,
        or ``FILE+FILE`` of two people
    options : of captures

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
    files = _files_of(word)
    if all(file.is_file() for file in files):
        return _read_captures(files, options)
    missing = [file for file in files if not file.exists()]
    if len(missing) < len(files) and missing:
        raise CommandError(f"{missing[0]}: no such file")
    if any(file.is_dir() for file in files):
        raise CommandError(f"{word}: wanted a file or a clip; got a folder: FOLDER:NAME is a clip")
    if dataset := _dataset_of(word):
        return _read_stored(dataset, word)
    if (CLIPS_FOLDER / MOTIONS).exists():
        return _read_stored(CLIPS_FOLDER, word)
    raise CommandError(
        f"{word}: no such file, and no {CLIPS_FOLDER / MOTIONS} with a clip of that name; "
        "./run makes it; a clip of another folder is FOLDER:NAME"
    )


def _files_of(word: str) -> list[Path]:
    """Return the file of this name, or the two whose names a plus joins."""
    return [Path(word)] if Path(word).is_file() else [Path(part) for part in word.split("+")]


def _dataset_of(name: str) -> Path | None:
    """Return the first folder of variations that has one of this name."""
    if not is_variation(name):
        return None
    for table in sorted(in_project(VARIATIONS_FOLDER).glob(f"*/{VARIATIONS}")):
        if any(row.variation == name for row in read_variations(table)):
            return table.parent
    return None


def _read_stored(store: Path, name: str) -> NamedClip:
    """Read a clip of the store; the colour of a person does not depend on who reacts."""
    if not name:
        hint = f": {some_clips(store, f'{store}:')}" if store.is_file() else " (pacmo clips)"
        raise CommandError(f"{store}: wanted the name of a clip after the colon{hint}")
    file = _file_of(store, name) if store.is_dir() else store
    clip = read_clip(file, name)
    # The folder distinguishes reactions to the same partner, such as pacmo/1.
    folder = "/".join(store.parts[-2:]) if is_reaction(name) and store.is_dir() else ""
    label = f"{folder} · {name}" if folder else name
    swap = is_reaction(name) and ReactionName.parse(name).direction == "a"
    return NamedClip(Scene.of(label, clip.swapped() if swap else clip), [file])


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


def _read_captures(files: list[Path], options: ReadOptions) -> NamedClip:
    if any(names_clips(file, "") for file in files):
        file = next(file for file in files if names_clips(file, ""))
        raise CommandError(f"{file}: name the clip as FILE:NAME: {some_clips(file, f'{file}:')}")
    pairs = all(options.format_of(file) in ONE_PERSON_FORMATS for file in files)
    if len(files) > (2 if pairs else 1):
        raise CommandError(f"{files[0]}: wanted {'at most two files' if pairs else 'one file'}")
    label = " + ".join(map(capture_name, files))
    alone = len(files) == 1 and (pairs or _holds_one_person(files[0], options))
    sources = [Source(files[0], "a", None)] if alone else two_sources(files)
    read = read_people(sources, options, "")
    people = [person.motion for person in read]
    if len(people) == 2:
        people = list(on_one_clock(people[0], people[1], label))
        check_two_people(people[0], people[1], files)
    return NamedClip(scene_of_people(label, people), files, sources, read)


def _holds_one_person(file: Path, options: ReadOptions) -> bool:
    form = options.format_of(file)
    return holds_one_person(file, form, options.settings(form, "a"))


def scene_of_people(label: str, people: Sequence[PersonMotion]) -> Scene:
    """Show one or two people of the same times, whose skeletons may differ."""
    first, last = people[0], people[-1]
    other = last.skeleton if last.skeleton != first.skeleton else None
    motions = tuple(person.motion for person in people)
    return Scene(label, first.skeleton, first.times, motions, other)


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


def _described(scene: Scene) -> str:
    """Say what is played: people, joints of each, frames and rate."""
    joints = " and ".join(str(len(body.joints)) for body in scene.skeletons)
    people = "1 person" if len(scene.people) == 1 else "2 people"
    rate = rate_text(frame_rate(scene.times)) if len(scene.times) > 1 else "0"
    return (
        f"{scene.label}: {people} of {joints} joints, {len(scene.times):,} frames at {rate} "
        "frames a second"
    )


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


def view(  # noqa: PLR0913  # typer reads the options off the signature
    clips: Clips,
    out: Out = Path("view.html"),
    contact: Contact = 0.1,
    open_it: Open = True,
    label: Labels = [],  # noqa: B006  # typer copies it
    form: FormatName = None,
    preset: Preset = None,
    from_unit: FromUnit = [],  # noqa: B006  # typer copies it
    from_up: FromUp = [],  # noqa: B006
    from_fps: FromFps = [],  # noqa: B006
) -> None:
    """Play clips side by side in 3-D, in one HTML page.

    pacmo view S001C001P001R001A050

    pacmo view NAME data/reactions/1/pacmo/1:NAME#b#0

    pacmo view walk_A.bvh+walk_B.bvh

    pacmo view x_A.bvh+x_B.bvh new/x_A.bvh+new/x_B.bvh --preset pair --label before --label after

    A CLIP is the name of a clip or of a variation (pacmo clips --variations), FOLDER:NAME or
    FILE.parquet:NAME elsewhere, the FILE of a capture, or FILE+FILE if each person has a file. Up
    to six clips play at the same time, whatever their frame rates. The page is one file and needs
    neither network nor server.
    """
    options = ReadOptions(form, preset, from_unit, from_up, from_fps)
    with reading_errors_in_one_line():
        if len(clips) > MAX_CLIPS:
            raise CommandError(f"wanted at most {MAX_CLIPS} clips side by side; got {len(clips)}")
        named = read_named_clips(clips, options)
        check_outputs(out, [out], [file for clip in named for file in clip.files])
        if out.suffix.lower() not in PAGES:
            raise CommandError(
                f"{out}: wanted a suffix of {', '.join(PAGES)}; pacmo export makes pictures "
                "(.png), films and other files"
            )
        scenes = _with_labels([clip.scene for clip in named], clips, label)
        write_text(out, render_viewer(scenes, contact=contact))
    for scene in scenes:
        typer.echo(_described(scene))
    typer.echo(f"{out}: {len(scenes)} {'clip' if len(scenes) == 1 else 'clips'}")
    if open_it:
        webbrowser.open(out.resolve().as_uri())
