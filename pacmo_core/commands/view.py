"""``pacmo view``: clips of the store or captures of any format, played in a page."""

import webbrowser
from pathlib import Path
from typing import Annotated

import typer

from pacmo_core.commands.captures import (
    check_same_skeleton,
    names_clips,
    on_one_clock,
    two_sources,
)
from pacmo_core.commands.reading import (
    FormatName,
    FromFps,
    FromUnit,
    FromUp,
    Preset,
    ReadOptions,
    Source,
    checked_settings,
    read_people,
)
from pacmo_core.data.names import ReactionName, is_reaction
from pacmo_core.figures.viewer import MAX_CLIPS, Scene, render_viewer
from pacmo_core.formats.registry import ONE_PERSON_FORMATS, holds_one_person
from pacmo_core.project.workspace import MOTIONS, CommandError, reading_errors_in_one_line
from pacmo_core.store.files import write_text
from pacmo_core.store.motions import motion_file, read_motion
from pacmo_core.store.tables import ACCEPTED, FAILED, SOURCES, VARIATIONS, read_variations

CLIPS_FOLDER = Path("data/clips")


def read_scene(word: str, options: ReadOptions) -> Scene:
    """Read the clip that an argument of the command line names.

    Parameters
    ----------
    word : ``NAME`` of a clip in ``data/clips``, ``STORE:NAME`` of one in another folder or file
        (a variation's name is ``CLIP~NAME``), ``FILE`` of a capture, or ``FILE+FILE`` of two people
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
    files = [Path(part) for part in word.split("+")]
    if all(file.is_file() for file in files):
        return _read_captures(files, options)
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


def _read_captures(files: list[Path], options: ReadOptions) -> Scene:
    if any(names_clips(file, "") for file in files):
        raise CommandError(f"{files[0]}: name the clip, {files[0]}:NAME")
    form = options.format_of(files[0])
    pairs = form in ONE_PERSON_FORMATS
    if len(files) > (2 if pairs else 1):
        raise CommandError(f"{files[0]}: wanted {'at most two files' if pairs else 'one file'}")
    label = " + ".join(file.stem for file in files)
    alone = len(files) == 1 and (pairs or _holds_one_person(files[0], form, options))
    sources = [Source(files[0], "a", None)] if alone else two_sources(files)
    people = [person.motion for person in read_people(sources, options, "")]
    if len(people) == 2:
        people = list(on_one_clock(people[0], people[1], label))
        check_same_skeleton(files[-1], people[0], people[1])
    first = people[0]
    return Scene(label, first.skeleton, first.times, tuple(person.motion for person in people))


def _holds_one_person(file: Path, form: str, options: ReadOptions) -> bool:
    settings = checked_settings(form, Source(file, "a", None), options)
    return holds_one_person(file, form, settings)


Clips = Annotated[
    list[str], typer.Argument(metavar="CLIP...", help="NAME, FOLDER:NAME, FILE or FILE+FILE")
]
Out = Annotated[Path, typer.Option(help="the HTML file to write")]
Contact = Annotated[
    float,
    typer.Option(min=0, help="distance in metres below which joints are marked as in contact"),
]
Open = Annotated[bool, typer.Option("--open/--no-open", help="open it in the browser")]


def view(  # noqa: PLR0913  # typer reads the options off the signature
    clips: Clips,
    out: Out = Path("view.html"),
    contact: Contact = 0.1,
    open_it: Open = True,
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

    A CLIP is the name of a clip in data/clips, FOLDER:NAME or FILE.parquet:NAME elsewhere, the FILE
    of a capture, or FILE+FILE if each person has a file. Up to six clips play at the same time,
    whatever their frame rates. The page is one file and needs neither network nor server.
    """
    options = ReadOptions(form, preset, from_unit, from_up, from_fps)
    with reading_errors_in_one_line():
        if len(clips) > MAX_CLIPS:
            raise CommandError(f"wanted at most {MAX_CLIPS} clips side by side; got {len(clips)}")
        scenes = [read_scene(word, options) for word in clips]
        write_text(out, render_viewer(scenes, contact=contact))
    typer.echo(f"{out}: {len(scenes)} {'clip' if len(scenes) == 1 else 'clips'}")
    if open_it:
        webbrowser.open(out.resolve().as_uri())
