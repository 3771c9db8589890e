"""``pacmo view``: clips side by side in a page that plays them."""

import webbrowser
from pathlib import Path
from typing import Annotated

import typer

from apps.shown import read_scene
from pacmo_core.figures.viewer import MOST, render_viewer
from pacmo_core.project.workspace import CommandError, reading_errors_in_one_line
from pacmo_core.store.files import write_text

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
        if len(clips) > MOST:
            raise CommandError(f"wanted at most {MOST} clips side by side; got {len(clips)}")
        scenes = [read_scene(word, form, settings) for word in clips]
        write_text(out, render_viewer(scenes, contact=contact))
    typer.echo(f"{out}: {len(scenes)} {'clip' if len(scenes) == 1 else 'clips'}")
    if open_it:
        webbrowser.open(out.resolve().as_uri())
