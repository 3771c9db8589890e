"""``pacmo view``: clips of the store or captures of any format, played in a page."""

import webbrowser
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from pacmo_core.commands.captures import names_clips
from pacmo_core.data.interaction import Interaction
from pacmo_core.data.names import ReactionName, is_reaction
from pacmo_core.figures.viewer import MAX_CLIPS, Scene, render_viewer
from pacmo_core.formats.base import RawSequence, read_capture
from pacmo_core.formats.registry import (
    DEFAULT_SETTINGS,
    ONE_PERSON_FORMATS,
    format_of,
    open_format,
    read_single,
)
from pacmo_core.project.workspace import MOTIONS, CommandError, reading_errors_in_one_line
from pacmo_core.store.files import write_text
from pacmo_core.store.motions import motion_file, read_motion
from pacmo_core.store.tables import ACCEPTED, FAILED, SOURCES, VARIATIONS, read_variations

CLIPS_FOLDER = Path("data/clips")


def read_scene(word: str, form: str | None, settings: Mapping[str, Any]) -> Scene:
    """Read the clip that an argument of the command line names.

    Parameters
    ----------
    word : ``NAME`` of a clip in ``data/clips``, ``STORE:NAME`` of one in another folder or file
        (a variation's name is ``CLIP~NAME``), ``FILE`` of a capture, or ``FILE+FILE`` of two people
    form : format of captures; None to infer it from their suffixes
    settings : overrides of the default settings of the format

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
        return _read_captures(files, form, settings)
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


def _read_captures(files: list[Path], form: str | None, settings: Mapping[str, Any]) -> Scene:
    if any(names_clips(file, "") for file in files):
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
    label = " + ".join(file.stem for file in files)
    if single := read_single(files[0], opened):
        return Scene(label, single.skeleton, single.times, (single.motion,))
    # Formats with one person per file pair two files; one file is paired with itself.
    both = (files[0], files[-1]) if pairs else (files[0],)
    interaction = read_capture(opened, RawSequence(files[0].stem, both)).interaction
    alone = pairs and len(files) == 1
    return _one_person_scene(label, interaction) if alone else Scene.of(label, interaction)


def _one_person_scene(label: str, interaction: Interaction) -> Scene:
    return Scene(label, interaction.skeleton, interaction.times, (interaction.person_a,))


def _settings_with_rates(
    files: list[Path], form: str, settings: Mapping[str, Any]
) -> Mapping[str, Any]:
    """Return the settings with frame rates by subject, as the format cmu has them."""
    if form != "cmu" or "fps" not in settings:
        return settings
    return {**settings, "fps": {file.stem.partition("_")[0]: settings["fps"] for file in files}}


Clips = Annotated[
    list[str], typer.Argument(metavar="CLIP...", help="NAME, FOLDER:NAME, FILE or FILE+FILE")
]
Out = Annotated[Path, typer.Option(help="the HTML file to write")]
Contact = Annotated[
    float,
    typer.Option(min=0, help="distance in metres below which joints are marked as in contact"),
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

    A CLIP is the name of a clip in data/clips, FOLDER:NAME or FILE.parquet:NAME elsewhere, the FILE
    of a capture, or FILE+FILE if each person has a file. Up to six clips play at the same time,
    whatever their frame rates. The page is one file and needs neither network nor server.
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
