"""Clips named on the command line: of the store, or captures of any format that is read."""

import webbrowser
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.names import ReactionName, is_reaction
from pacmo_core.figures.viewer import MAX_CLIPS, Scene, render_viewer
from pacmo_core.formats.base import RawSequence
from pacmo_core.formats.registry import DEFAULT_SETTINGS, ONE_PERSON_FORMATS, format_of, open_format
from pacmo_core.project.workspace import MOTIONS, CommandError, reading_errors_in_one_line
from pacmo_core.store.files import write_text
from pacmo_core.store.motions import motion_file, read_motion
from pacmo_core.store.tables import ACCEPTED, FAILED, SOURCES, VARIATIONS, read_variations

CLIPS_FOLDER = Path("data/clips")


def read_scene(word: str, form: str | None, settings: Mapping[str, Any]) -> Scene:
    """Read what a word of the command line names.

    Parameters
    ----------
    word : ``NAME`` of a clip in ``data/clips``, ``STORE:NAME`` of one in another folder or file
        (a variation's name is ``CLIP~NAME``), ``FILE`` of a capture, or ``FILE+FILE`` of two people
    form : the captures' format, None to go by their endings
    settings : what differs from the format's published facts

    Raises
    ------
    CommandError
        If the word names nothing, or what it names needs more to be said.
    FormatError, StoreError, KeyError, ValueError
        As the readers say.
    """
    store, colon, name = word.partition(":")
    if colon and Path(store).exists():
        return _read_stored(Path(store), name)
    files = [Path(part) for part in word.split("+")]
    if all(file.is_file() for file in files):
        return _read_captures(files, form, settings)
    if (CLIPS_FOLDER / MOTIONS).exists() and len(files) == 1:
        return _read_stored(CLIPS_FOLDER, word)
    raise CommandError(
        f"{word}: no such file, and no {CLIPS_FOLDER / MOTIONS} here to hold a clip of that name; "
        "a clip of another folder is FOLDER:NAME"
    )


def _read_stored(store: Path, name: str) -> Scene:
    """Show a clip of the store; a reaction keeps the colour of the person who reacts."""
    if not name:
        raise CommandError(f"{store}: wanted the name of a clip after the colon (pacmo clips)")
    found = read_motion(_file_of(store, name) if store.is_dir() else store, name)
    # A reaction is told from others to the same partner by its folder, as pacmo/1.
    folder = "/".join(store.parts[-2:]) if is_reaction(name) and store.is_dir() else ""
    label = f"{folder} · {name}" if folder else name
    swap = is_reaction(name) and ReactionName.parse(name).direction == "a"
    return Scene.of(label, found.swapped() if swap else found)


def _file_of(folder: Path, name: str) -> Path:
    """Say which file of a folder holds a clip; in one of variations each source has its own."""
    facts = folder / VARIATIONS
    if not facts.exists():
        return folder / MOTIONS
    rows = [row for row in read_variations(facts) if name in (row.variation, row.clip)]
    if not rows:
        raise CommandError(f"{facts}: no variation {name}, and no clip of that name was varied")
    row = rows[0]
    if name == row.clip:
        return motion_file(folder / SOURCES, row.clip)
    if not row.measurements:
        raise CommandError(f"{facts}: {name} was not made: {row.reason}")
    return motion_file(folder / (ACCEPTED if row.accepted else FAILED), row.clip)


def _read_captures(files: list[Path], form: str | None, settings: Mapping[str, Any]) -> Scene:
    if any(file.suffix.lower() == ".parquet" for file in files):
        raise CommandError(f"{files[0]}: name the clip, {files[0]}:NAME")
    form = form or format_of(files[0])
    if form not in DEFAULT_SETTINGS:
        raise CommandError(f"no format {form!r}; there are {', '.join(DEFAULT_SETTINGS)}")
    pairs = form in ONE_PERSON_FORMATS
    if len(files) > (2 if pairs else 1):
        raise CommandError(f"{files[0]}: wanted {'at most two files' if pairs else 'one file'}")
    opened = open_format(
        form, {**DEFAULT_SETTINGS[form], **_settings_with_rates(files, form, settings)}
    )
    # Every format of one person a file pairs people; a person paired with himself is one.
    both = (files[0], files[-1]) if pairs else (files[0],)
    interaction = opened.read(RawSequence(files[0].stem, both)).interaction
    label = " + ".join(file.stem for file in files)
    alone = pairs and len(files) == 1
    return _make_scene(label, interaction) if alone else Scene.of(label, interaction)


def _make_scene(label: str, seen: Interaction) -> Scene:
    return Scene(label, seen.skeleton, seen.times, (seen.person_a,))


def _settings_with_rates(
    files: list[Path], form: str, settings: Mapping[str, Any]
) -> Mapping[str, Any]:
    """CMU's rates go by subject, which is the first word of a file's name."""
    if form != "cmu" or "fps" not in settings:
        return settings
    return {**settings, "fps": {file.stem.partition("_")[0]: settings["fps"] for file in files}}


Clips = Annotated[
    list[str], typer.Argument(metavar="CLIP...", help="NAME, FOLDER:NAME, FILE or FILE+FILE")
]
Out = Annotated[Path, typer.Option(help="the page")]
Contact = Annotated[float, typer.Option(min=0, help="metres between joints that touch")]
Open = Annotated[bool, typer.Option("--open/--no-open", help="open it in the browser")]
FormatName = Annotated[
    str | None, typer.Option("--format", help="of captures, if the ending does not tell")
]
Preset = Annotated[str | None, typer.Option(help="of BVH files: duo_mocap, cmu_18_19, ...")]
Unit = Annotated[float | None, typer.Option(help="metres a unit of a BVH file")]
Up = Annotated[str | None, typer.Option(help="the captures' upward axis, y or z")]
CaptureFps = Annotated[
    float | None, typer.Option("--fps", help="where a capture states none, or a wrong one")
]


def view(  # noqa: PLR0913  # typer reads the options off the signature
    clips: Clips,
    out: Out = Path("view.html"),
    contact: Contact = 0.1,
    open_it: Open = True,
    form: FormatName = None,
    preset: Preset = None,
    unit: Unit = None,
    up: Up = None,
    fps: CaptureFps = None,
) -> None:
    """Play clips side by side in 3-D, in a page of one file.

    pacmo view S001C001P001R001A050

    pacmo view NAME data/reactions/1/pacmo/1:NAME#b#0

    pacmo view walk_A.bvh+walk_B.bvh --unit 0.01 --up y

    A CLIP is the name of one in data/clips, FOLDER:NAME of one in another folder of the store (or
    in a Parquet file), a capture's FILE, or FILE+FILE where each person has one; up to six, on one
    clock, whatever their rates. The page needs no network and no server, and opens by double click.
    """
    options = {"preset": preset, "unit": unit, "up": up, "fps": fps}
    settings = {name: value for name, value in options.items() if value is not None}
    with reading_errors_in_one_line():
        if len(clips) > MAX_CLIPS:
            raise CommandError(f"wanted at most {MAX_CLIPS} clips side by side; got {len(clips)}")
        scenes = [read_scene(word, form, settings) for word in clips]
        write_text(out, render_viewer(scenes, contact=contact))
    typer.echo(f"{out}: {len(scenes)} {'clip' if len(scenes) == 1 else 'clips'}")
    if open_it:
        webbrowser.open(out.resolve().as_uri())
