"""``pacmo export``: a clip in other tools' formats."""

from pathlib import Path
from typing import Annotated

import typer

from apps.exports import Form, export
from apps.shown import read_scene
from pacmo_core.project.workspace import reading_errors_in_one_line

Clip = Annotated[str, typer.Argument(metavar="CLIP", help="NAME, FOLDER:NAME, FILE or FILE+FILE")]
Out = Annotated[Path, typer.Option(help="FILE.bvh, .glb, .gltf, .csv, .npz, .mp4 or .gif")]
Fps = Annotated[float | None, typer.Option(help="of the file; the clip's own, a film's 25")]
Up = Annotated[str, typer.Option(help="the file's upward axis, y or z")]
Unit = Annotated[float, typer.Option(help="metres a unit of the file; 0.01 is centimetres")]
FormatName = Annotated[
    str | None, typer.Option("--format", help="of a capture, if the ending does not tell")
]
Preset = Annotated[str | None, typer.Option(help="of BVH captures: duo_mocap, cmu_18_19, ...")]
FromUnit = Annotated[float | None, typer.Option(help="metres a unit of a BVH capture")]
FromUp = Annotated[str | None, typer.Option(help="a capture's upward axis, y or z")]
FromFps = Annotated[float | None, typer.Option(help="where a capture states none, or a wrong one")]


def export_clip(  # noqa: PLR0913  # typer reads the options off the signature
    clip: Clip,
    out: Out,
    fps: Fps = None,
    up: Up = "y",
    unit: Unit = 1.0,
    form: FormatName = None,
    preset: Preset = None,
    from_unit: FromUnit = None,
    from_up: FromUp = None,
    from_fps: FromFps = None,
) -> None:
    """Write a clip for another tool; the file's ending says for which.

    pacmo export S001C001P001R001A050 --out push.glb

    pacmo export data/reactions/1/pacmo/1:NAME#b#0 --out push.bvh --up z --unit 0.01 --fps 60

    pacmo export walk_A.bvh+walk_B.bvh --from-unit 0.01 --from-up y --out walk.gif

    .bvh: a file a person, FILE_A.bvh and FILE_B.bvh. .glb, .gltf: glTF 2.0, both people with
    skeleton, skin and animation, metres, y up. Both have rotations of constant bones, and the
    command says how far that moved joints. .csv: a row a frame. .npz: NumPy. .mp4, .gif: a film;
    MP4 needs ffmpeg (pip install imageio-ffmpeg). A CLIP is named as for ``pacmo view``.
    """
    options = {"preset": preset, "unit": from_unit, "up": from_up, "fps": from_fps}
    settings = {name: value for name, value in options.items() if value is not None}
    with reading_errors_in_one_line():
        wanted = Form(fps, up, unit)
        wanted.check(out)
        files, lost = export(read_scene(clip, form, settings), out, wanted)
    typer.echo(", ".join(map(str, files)) + (f"; {lost}" if lost else ""))
