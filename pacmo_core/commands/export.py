"""``pacmo export``: a clip in the format of another tool, by the suffix of the file."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray

from pacmo_core.commands.reading import (
    FormatName,
    FromFps,
    FromUnit,
    FromUp,
    Preset,
    ReadOptions,
    check_unit,
    parse_unit,
)
from pacmo_core.commands.view import read_scene
from pacmo_core.data.interaction import Interaction, Motion
from pacmo_core.data.limits import work_fault
from pacmo_core.figures.body_mesh import make_skin
from pacmo_core.figures.body_shape import make_body_shape
from pacmo_core.figures.stills import check_gif_rate, find_ffmpeg, write_film
from pacmo_core.figures.viewer import Scene
from pacmo_core.formats.base import check_up
from pacmo_core.formats.fit_bones import ConstantBoneMotion, fit_bones
from pacmo_core.formats.resample import from_y_up, resample, sample_times
from pacmo_core.formats.write_bvh import format_bvh_of_fit
from pacmo_core.formats.write_gltf import (
    AnimatedPerson,
    gltf_document,
    rest_positions,
    to_glb,
    to_gltf,
)
from pacmo_core.formats.write_tables import TABLE_WRITERS, JointTable
from pacmo_core.project.workspace import CommandError, reading_errors_in_one_line
from pacmo_core.store.files import atomic_file, write_text

FILM_FPS = 25.0
COLOURS = ((0.0, 0.168, 0.445), (0.665, 0.112, 0.0))  # the viewer's blue and vermilion, linear
# The glTF standard prescribes metres and y up; a film shows no axis.
FIXED_UNIT_SUFFIXES = (".glb", ".gltf", ".mp4", ".gif")


@dataclass(frozen=True)
class ExportOptions:
    """Frames per second (None: those of the clip), up axis, metres per unit."""

    fps: float | None
    up: str
    unit: float

    def check(self, out: Path) -> None:
        """Reject options that the format does not support.

        Raises
        ------
        CommandError
            If the suffix is unknown, or the format fixes the axis and the unit.
        """
        suffix = out.suffix.lower()
        if suffix not in WRITERS:
            raise CommandError(f"{out}: wanted a suffix of {', '.join(WRITERS)}")
        check_up(self.up)
        check_unit(self.unit, "--to-unit")
        if suffix in FIXED_UNIT_SUFFIXES and (self.up, self.unit) != ("y", 1.0):
            raise CommandError(
                f"{out}: {suffix} is always metres, y up; leave out --to-up and --to-unit"
            )
        if suffix == ".gif":
            check_gif_rate(self.fps or FILM_FPS)
        if suffix == ".mp4":
            find_ffmpeg()


def export_scene(scene: Scene, out: Path, form: ExportOptions) -> tuple[list[Path], str]:
    """Write the files, each atomically; return them and a summary of the errors."""
    suffix = out.suffix.lower()
    fps = FILM_FPS if form.fps is None and suffix in (".mp4", ".gif") else form.fps
    return WRITERS[suffix](out, scene if fps is None else resample_scene(scene, fps), form)


def resample_scene(scene: Scene, fps: float) -> Scene:
    """Return the scene at another frame rate."""
    at = sample_times(scene.times, fps)
    if fault := work_fault(len(at), len(scene.skeleton.joints)):
        raise CommandError(f"--to-fps {fps:g}: {fault}")
    people = tuple(resample(motion, scene.times, at) for motion in scene.people)
    return replace(scene, times=at - at[0], people=people)


def _fps(scene: Scene) -> float:
    return float(1 / np.median(np.diff(scene.times)))


def _convert(scene: Scene, form: ExportOptions) -> list[Motion]:
    return [(from_y_up(m, form.up) / form.unit).astype(np.float32) for m in scene.people]


def _bvh(out: Path, scene: Scene, form: ExportOptions) -> tuple[list[Path], str]:
    files, errors = [], []
    for person, motion in zip("AB", scene.people, strict=False):
        fitted = fit_bones(from_y_up(motion, form.up), scene.skeleton)
        errors.append(_position_errors(fitted, from_y_up(motion, form.up), scene))
        in_units = replace(fitted, offsets=fitted.offsets / form.unit, root=fitted.root / form.unit)
        alone = len(scene.people) == 1
        files.append(out if alone else out.with_name(f"{out.stem}_{person}{out.suffix}"))
        write_text(files[-1], format_bvh_of_fit(in_units, _fps(scene), scene.skeleton))
    return files, _error_summary(errors)


def _gltf(out: Path, scene: Scene, _: ExportOptions) -> tuple[list[Path], str]:
    actors, errors = [], []
    for person, motion, colour in zip("ab", scene.people, COLOURS, strict=False):
        fitted = fit_bones(motion, scene.skeleton)
        errors.append(_position_errors(fitted, motion, scene))
        rest = rest_positions(fitted, scene.skeleton)
        skin = make_skin(make_body_shape(scene.skeleton), scene.skeleton, rest)
        actors.append(AnimatedPerson(person, fitted, skin, colour))
    document, data = gltf_document(scene.skeleton, scene.times, actors)
    write = to_glb if out.suffix.lower() == ".glb" else to_gltf
    _write_bytes(out, write(document, data))
    return [out], _error_summary(errors)


def _table(out: Path, scene: Scene, form: ExportOptions) -> tuple[list[Path], str]:
    table = JointTable(scene.skeleton, scene.times, _convert(scene, form), form.up, form.unit)
    _write_bytes(out, TABLE_WRITERS[out.suffix.lower()](table))
    return [out], ""


def _film(out: Path, scene: Scene, form: ExportOptions) -> tuple[list[Path], str]:
    # The first person is orange in stills and blue in the viewer.
    clip = Interaction(scene.skeleton, scene.times, scene.people[-1], scene.people[0])
    with atomic_file(out) as partial:
        # The film writers choose the format by the suffix.
        named = partial.with_name(partial.name + out.suffix.lower())
        try:
            write_film(named, clip, form.fps or FILM_FPS)
            named.replace(partial)
        finally:
            named.unlink(missing_ok=True)
    return [out], ""


def _write_bytes(out: Path, content: bytes) -> None:
    with atomic_file(out) as partial:
        partial.write_bytes(content)


def _position_errors(
    fitted: ConstantBoneMotion, motion: Motion, scene: Scene
) -> NDArray[np.float64]:
    """Return ``(T, J)`` metres between the joints and those of the fit with constant bones."""
    errors: NDArray[np.float64] = np.linalg.norm(fitted.positions(scene.skeleton) - motion, axis=-1)
    return errors


def _error_summary(errors: list[NDArray[np.float64]]) -> str:
    millimetres = 1000 * np.stack(errors)
    return (
        f"constant bones moved joints by {millimetres.mean():.1f} mm on average, "
        f"{millimetres.max():.1f} at most"
    )


WRITERS: dict[str, Callable[[Path, Scene, ExportOptions], tuple[list[Path], str]]] = {
    ".bvh": _bvh,
    ".glb": _gltf,
    ".gltf": _gltf,
    **dict.fromkeys(TABLE_WRITERS, _table),
    ".mp4": _film,
    ".gif": _film,
}


Clip = Annotated[str, typer.Argument(metavar="CLIP", help="NAME, FOLDER:NAME, FILE or FILE+FILE")]
Out = Annotated[
    Path, typer.Option(help="FILE.bvh, .glb, .gltf, .npz, .csv, .parquet, .mp4 or .gif")
]
ToFps = Annotated[
    float | None,
    typer.Option(help="frame rate of the file; default: that of the clip, 25 for films"),
]
ToUp = Annotated[str, typer.Option(help="up axis of the file, y or z")]
ToUnit = Annotated[str, typer.Option(help="metres per unit of the file, or m, cm, mm, in")]


def export(  # noqa: PLR0913  # typer reads the options off the signature
    clip: Clip,
    out: Out,
    form: FormatName = None,
    preset: Preset = None,
    from_unit: FromUnit = [],  # noqa: B006  # typer copies it
    from_up: FromUp = [],  # noqa: B006
    from_fps: FromFps = [],  # noqa: B006
    to_unit: ToUnit = "m",
    to_up: ToUp = "y",
    to_fps: ToFps = None,
) -> None:
    """Write a clip in the format of another tool, by the suffix of the file.

    pacmo export S001C001P001R001A050 --out push.glb

    pacmo export data/reactions/1/pacmo/1:NAME#b#0 --out push.bvh --to-up z --to-unit cm --to-fps 60

    pacmo export walk_A.bvh+walk_B.bvh --from-unit cm --from-up y --out walk.gif

    .bvh: one file per person, FILE_A.bvh and FILE_B.bvh. .glb, .gltf: glTF 2.0, both people with
    skeleton, skin and animation, in metres, y up. These formats hold rotations of bones of constant
    length; the command prints how far that moved joints. .npz, .csv, .parquet: a table of joints,
    which every command reads as a capture. .mp4, .gif: a film; MP4 needs ffmpeg (pip install
    imageio-ffmpeg). A CLIP is named as for ``pacmo view``.
    """
    options = ReadOptions(form, preset, from_unit, from_up, from_fps)
    with reading_errors_in_one_line():
        form_of_file = ExportOptions(to_fps, to_up, parse_unit(to_unit, "--to-unit"))
        form_of_file.check(out)
        files, summary = export_scene(read_scene(clip, options), out, form_of_file)
    typer.echo(", ".join(map(str, files)) + (f"; {summary}" if summary else ""))
