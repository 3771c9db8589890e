"""``pacmo export``: a clip in the format of another tool, by the suffix of the file."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray

from pacmo_core.commands.bvh_fidelity import Fidelity, pair_targets, planted_weights
from pacmo_core.commands.captures import (
    OutputSpace,
    check_outputs,
    meant_rate,
    meant_times,
    rate_text,
)
from pacmo_core.commands.reading import (
    FormatName,
    FromFps,
    FromUnit,
    FromUp,
    Preset,
    ReadOptions,
    check_axis,
    check_unit,
    parse_unit,
)
from pacmo_core.commands.rig import OwnRig, own_rigs
from pacmo_core.commands.view import read_named_clips
from pacmo_core.data.interaction import Motion
from pacmo_core.data.limits import work_fault
from pacmo_core.figures.body_mesh import make_skin
from pacmo_core.figures.body_shape import make_body_shape
from pacmo_core.figures.stills import check_gif_rate, find_ffmpeg, write_film, write_strip
from pacmo_core.figures.viewer import Scene
from pacmo_core.formats.base import FormatError, to_y_up
from pacmo_core.formats.bvh import Bvh
from pacmo_core.formats.bvh_channels import check_channels, format_file
from pacmo_core.formats.convert_bvh import bone_motion, check_constant_bones, move_root
from pacmo_core.formats.fit_bones import ConstantBoneMotion, fit_bones, reach_targets
from pacmo_core.formats.registry import PersonMotion
from pacmo_core.formats.resample import frame_rate, from_y_up, resample, sample_times
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
FILMS = (".mp4", ".gif")
PICTURE = ".png"
OF_A_PERSON = (".bvh", ".glb", ".gltf")  # with a skeleton for each person
# The glTF standard prescribes metres and y up; films and pictures show no axis.
FIXED_UNIT_SUFFIXES = (".glb", ".gltf", *FILMS, PICTURE)


@dataclass(frozen=True)
class ExportOptions:
    """Frames per second (None: those of the clip), up axis, metres per unit, and the place.

    Parameters
    ----------
    ground : the lowest joint of the clip gets height zero
    centre : the mean position of the roots gets above the origin
    """

    fps: float | None
    up: str
    unit: float
    ground: bool = False
    centre: bool = False

    @property
    def space(self) -> OutputSpace:
        """The unit and axis of the file."""
        return OutputSpace(self.unit, self.up)

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
        if out.is_dir():
            raise CommandError(f"{out}: a folder; wanted a file")
        check_axis(self.up, "--to-up")
        check_unit(self.unit, "--to-unit")
        if suffix in FIXED_UNIT_SUFFIXES and (self.up, self.unit) != ("y", 1.0):
            raise CommandError(
                f"{out}: {suffix} is always metres, y up; leave out --to-up and --to-unit"
            )
        if suffix in (*FILMS, PICTURE) and (self.ground or self.centre):
            kind = "picture" if suffix == PICTURE else "film"
            raise CommandError(f"{out}: a {kind} has no origin; leave out --ground and --centre")
        if suffix == PICTURE and self.fps is not None:
            raise CommandError(f"{out}: a picture has no frame rate; leave out --to-fps")
        if suffix == ".gif":
            check_gif_rate(self.fps or FILM_FPS)
        if suffix == ".mp4":
            find_ffmpeg()


def export_scene(
    scene: Scene, out: Path, form: ExportOptions, rigs: Sequence[OwnRig] = ()
) -> tuple[list[Path], str]:
    """Write the files, each atomically; return them and a summary: frames, rate and errors.

    Parameters
    ----------
    rigs : of all people, if their files are BVH: BVH and glTF are written on them
    """
    suffix = out.suffix.lower()
    if scene.other and suffix in TABLE_WRITERS:
        others = ", ".join(other for other in WRITERS if other not in TABLE_WRITERS)
        raise CommandError(
            f"{scene.label}: the two people have different skeletons; {suffix} holds one: export "
            f"one person at a time, or to {others}, which show or hold one each"
        )
    fps = FILM_FPS if form.fps is None and suffix in FILMS else form.fps
    fault = ""
    if suffix in OF_A_PERSON:
        on_rigs, fault = _converted(rigs, scene, fps, form, is_bvh=suffix == ".bvh")
        if on_rigs:
            names = " and ".join(str(rig.file) for rig in rigs)
            if suffix == ".bvh":
                files = _write_people(out, [format_file(rig, rig.motion) for rig in on_rigs])
            else:
                # Keys on the frames of the rate that is printed, not beside them.
                fps = meant_rate(1 / on_rigs[0].frame_time)
                times = np.arange(len(on_rigs[0].motion)) / np.float64(fps)
                files = _write_gltf(out, scene, times, [bone_motion(rig) for rig in on_rigs])
            rate = _rate_line(len(on_rigs[0].motion), 1 / on_rigs[0].frame_time)
            return files, f"{rate}, in {form.space}, with the rest pose of {names}"
    written = (
        replace(scene, times=meant_times(scene.times - scene.times[0]))
        if fps is None
        else resample_scene(scene, fps)
    )
    files, errors = WRITERS[suffix](out, written, form)
    summary = (
        f"sixteen instants of {len(written.times)} frames"
        if suffix == PICTURE
        else _rate_line(len(written.times), frame_rate(written.times))
    )
    if suffix in OF_A_PERSON:
        summary += f", in {form.space}, with the rest pose of a body fitted to the joints{fault}"
    return files, "; ".join(filter(None, (summary, errors)))


def _rate_line(n_frames: int, fps: float) -> str:
    return f"{n_frames} frames at {rate_text(fps)} frames a second"


def _converted(
    rigs: Sequence[OwnRig], scene: Scene, fps: float | None, form: ExportOptions, *, is_bvh: bool
) -> tuple[list[Bvh], str]:
    """Return people's files at the times of a scene, in the space of the output; or none, and why.

    ``--ground`` and ``--centre`` have moved them.
    """
    if not rigs:
        return [], ""
    if fps is not None:
        _check_work(scene, sample_times(scene.times, fps), fps)
    try:
        for rig in rigs:
            if not is_bvh:
                check_constant_bones(rig.file, rig.bvh)
            if form.ground or form.centre:
                check_channels(rig.file, rig.bvh)
        people = [rig.converted(scene.times, fps, form.space) for rig in rigs]
    except FormatError as fault:
        return [], f" ({fault})"
    joints = [
        np.delete(person.positions(), person.end_sites, axis=1) * form.unit for person in people
    ]
    shift = _shift(joints, [0] * len(people), form) / form.unit
    return [move_root(person, shift) for person in people], ""


def _check_work(scene: Scene, at: NDArray[np.float64], fps: float) -> None:
    """Refuse a frame rate of which there would be too many frames."""
    if fault := work_fault(len(at), len(scene.skeleton.joints)):
        raise CommandError(f"--to-fps {fps:g}: {fault}")


def parse_seconds(text: str) -> tuple[float, float]:
    """Return the first and the last second of FIRST:LAST, each of which may be left out.

    Raises
    ------
    CommandError
        If it is something else.
    """
    first, colon, last = text.partition(":")
    try:
        start, end = float(first or 0), float(last or math.inf)
    except ValueError:
        colon = ""
    if text and (not colon or min(start, end) < 0):
        raise CommandError(f"--seconds: wanted FIRST:LAST, such as 3:7.5 or 3:; got {text!r}")
    return start, end


def part_of(scene: Scene, seconds: str) -> Scene:
    """Return a part of a scene, at its times, as ``parse_seconds`` reads it; empty: all of it.

    Raises
    ------
    CommandError
        If it is no part of the scene, or one of fewer than two frames.
    """
    if not seconds:
        return scene
    times = scene.times - scene.times[0]
    start, end = parse_seconds(seconds)
    half = 0.5 / frame_rate(scene.times)
    rows = np.flatnonzero((times >= start - half) & (times < end + half))
    if len(rows) < 2:
        raise CommandError(
            f"--seconds: wanted two frames or more of {scene.label}, which has {times[-1]:.6g} s; "
            f"got {seconds}"
        )
    if math.inf > end > times[-1] + half:
        typer.echo(f"--seconds {seconds}: {scene.label} ends at {times[-1]:.6g} s")
    people = tuple(motion[rows] for motion in scene.people)
    return replace(scene, times=scene.times[rows], people=people)


def resample_scene(scene: Scene, fps: float) -> Scene:
    """Return the scene at another frame rate."""
    times = meant_times(scene.times)
    at = sample_times(times, fps)
    _check_work(scene, at, fps)
    people = tuple(resample(motion, times, at) for motion in scene.people)
    return replace(scene, times=at - at[0], people=people)


def _shift(
    people: Sequence[NDArray[Any]], roots: Sequence[int], form: ExportOptions
) -> NDArray[np.float64]:
    """``(3,)``: the translation of all people together that ``--ground`` and ``--centre`` ask for.

    Parameters
    ----------
    people : (T, J, 3) each, in the axes of the file
    roots : joint of each
    """
    up = "xyz".index(form.up)
    shift = np.zeros(3)
    if form.centre:
        paths = [motion[:, root] for motion, root in zip(people, roots, strict=True)]
        shift -= np.mean(paths, axis=(0, 1), dtype=np.float64)
    shift[up] = -min(float(motion[..., up].min()) for motion in people) if form.ground else 0.0
    return shift


def _convert(scene: Scene, form: ExportOptions) -> list[Motion]:
    people = [from_y_up(motion, form.up).astype(np.float64) for motion in scene.people]
    shift = _shift(people, [body.root for body in scene.skeletons], form)
    return [((motion + shift) / form.unit).astype(np.float32) for motion in people]


def _fit_people(scene: Scene, form: ExportOptions) -> tuple[list[ConstantBoneMotion], str]:
    """Fit constant bones to both people, in metres and the axes of the file; summarise the errors.

    What the bones cannot hold is left to the same joints as in files of ``react`` and ``augment``.
    The fits are placed, not the motions: it is the files whose feet stand on the floor.
    """
    people = [
        PersonMotion(body, scene.times, motion)
        for body, motion in zip(scene.skeletons, scene.people, strict=True)
    ]
    fits = [fit_bones(from_y_up(person.motion, form.up), person.skeleton) for person in people]
    found, names = _positions(fits, people, form), [f"person {p}" for p in "ab"[: len(people)]]
    fidelity = Fidelity.of(people, found, names)
    if fidelity.is_inexact:
        targets = (
            pair_targets(people[0], people[1])
            if len(people) == 2
            else [(person.motion, 1 + planted_weights(person)) for person in people]
        )
        fits = [
            reach_targets(fit, from_y_up(aims, form.up), weights, person.skeleton)
            for fit, person, (aims, weights) in zip(fits, people, targets, strict=True)
        ]
        found = _positions(fits, people, form)
        fidelity = Fidelity.of(people, found, names)
    in_file = [from_y_up(person.motion, form.up) for person in found]
    shift = _shift(in_file, [body.root for body in scene.skeletons], form)
    placed = [replace(fit, root=fit.root + shift) for fit in fits]
    return placed, fidelity.line() if fidelity.is_inexact else ""


def _positions(
    fits: list[ConstantBoneMotion], people: list[PersonMotion], form: ExportOptions
) -> list[PersonMotion]:
    """Return the people as fits in the axes of the file hold them, in metres, y up."""
    return [
        replace(person, motion=to_y_up(fit.positions(person.skeleton), form.up).astype(np.float32))
        for fit, person in zip(fits, people, strict=True)
    ]


def _bvh(out: Path, scene: Scene, form: ExportOptions) -> tuple[list[Path], str]:
    fits, summary = _fit_people(scene, form)
    texts = [
        format_bvh_of_fit(
            replace(fit, offsets=fit.offsets / form.unit, root=fit.root / form.unit),
            frame_rate(scene.times),
            body,
        )
        for fit, body in zip(fits, scene.skeletons, strict=True)
    ]
    return _write_people(out, texts), summary


def _person_files(out: Path) -> list[Path]:
    return [out.with_name(f"{out.stem}_{person}{out.suffix}") for person in "AB"]


def _write_people(out: Path, texts: Sequence[str]) -> list[Path]:
    """Write a file for each person; return them."""
    files = [out] if len(texts) == 1 else _person_files(out)
    for file, text in zip(files, texts, strict=True):
        write_text(file, text)
    return files


def _gltf(out: Path, scene: Scene, form: ExportOptions) -> tuple[list[Path], str]:
    fits, summary = _fit_people(scene, form)
    return _write_gltf(out, scene, scene.times, fits), summary


def _write_gltf(
    out: Path,
    scene: Scene,
    times: NDArray[np.float64],
    motions: Sequence[ConstantBoneMotion],
) -> list[Path]:
    actors = []
    for person, motion, body, colour in zip("ab", motions, scene.skeletons, COLOURS, strict=False):
        skin = make_skin(make_body_shape(body), body, rest_positions(motion, body))
        actors.append(AnimatedPerson(person, body, motion, skin, colour))
    document, data = gltf_document(times, actors)
    write = to_glb if out.suffix.lower() == ".glb" else to_gltf
    _write_bytes(out, write(document, data))
    return [out]


def _table(out: Path, scene: Scene, form: ExportOptions) -> tuple[list[Path], str]:
    table = JointTable(scene.skeleton, scene.times, _convert(scene, form), form.up, form.unit)
    _write_bytes(out, TABLE_WRITERS[out.suffix.lower()](table))
    return [out], ""


def _drawing(out: Path, scene: Scene, form: ExportOptions) -> tuple[list[Path], str]:
    with atomic_file(out) as partial:
        # The writers choose the format by the suffix.
        named = partial.with_name(partial.name + out.suffix.lower())
        try:
            if named.suffix == PICTURE:
                write_strip(named, scene)
            else:
                typer.echo(f"drawing {len(scene.times)} frames, some ten a second ...")
                write_film(named, scene, form.fps or FILM_FPS)
            named.replace(partial)
        finally:
            named.unlink(missing_ok=True)
    return [out], ""


def _write_bytes(out: Path, content: bytes) -> None:
    with atomic_file(out) as partial:
        partial.write_bytes(content)


WRITERS: dict[str, Callable[[Path, Scene, ExportOptions], tuple[list[Path], str]]] = {
    ".bvh": _bvh,
    ".glb": _gltf,
    ".gltf": _gltf,
    **dict.fromkeys(TABLE_WRITERS, _table),
    ".mp4": _drawing,
    ".gif": _drawing,
    PICTURE: _drawing,
}


Clip = Annotated[
    list[str],
    typer.Argument(metavar="CLIP", help="NAME, FOLDER:NAME, FILE, or FILE FILE of two people"),
]
Out = Annotated[
    Path, typer.Option(help="FILE.bvh, .glb, .gltf, .npz, .csv, .parquet, .mp4, .gif or .png")
]
ToFps = Annotated[
    float | None,
    typer.Option(help="frame rate of the file; default: that of the clip, 25 for films"),
]
ToUp = Annotated[str, typer.Option(help="up axis of the file, y or z")]
ToUnit = Annotated[str, typer.Option(help="metres per unit of the file, or m, cm, mm, in")]
Seconds = Annotated[
    str, typer.Option(help="a part of the clip, FIRST:LAST from its first frame, such as 3:7.5")
]
Ground = Annotated[
    bool,
    typer.Option(
        "--ground",
        help="put the lowest joint of the clip on the floor, height 0; the feet of the other "
        "person, or of other frames, may stay above it",
    ),
]
Centre = Annotated[
    bool, typer.Option("--centre", help="move the middle of the people above the origin")
]


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
    seconds: Seconds = "",
    ground: Ground = False,
    centre: Centre = False,
) -> None:
    """Write a clip in the format of another tool, by the suffix of the file.

    pacmo export S001C001P001R001A050 --out push.glb

    pacmo export data/reactions/1/pacmo/1:NAME#b#0 --out push.bvh --to-up z --to-unit cm --to-fps 60

    pacmo export walk_A.bvh walk_B.bvh --from-unit cm --from-up y --out walk.gif

    pacmo export walk_A.bvh walk_B.bvh --seconds 3:7.5 --out part.bvh

    .bvh: one file per person, FILE_A.bvh and FILE_B.bvh. .glb, .gltf: glTF 2.0, both people with an
    armature and a skin each, and one animation, in metres, y up. Of BVH files both are the rig
    itself, with its rest pose and rotations. These formats hold rotations of bones of
    constant length; the command prints how far that moved joints. .npz, .csv, .parquet: a table of
    joints, which every command reads as a capture. .mp4, .gif: a film; MP4 needs ffmpeg (pip
    install imageio-ffmpeg). .png: a picture of sixteen instants. A CLIP is named as for ``pacmo
    view``. --ground and --centre move both people alike, so that the interaction stays as it is.
    """
    options = ReadOptions(form, preset, from_unit, from_up, from_fps)
    with reading_errors_in_one_line():
        form_of_file = ExportOptions(
            to_fps, to_up, parse_unit(to_unit, "--to-unit"), ground, centre
        )
        form_of_file.check(out)
        parse_seconds(seconds)  # "3 7.5" would make 7.5 a clip
        if len(clip) > 2:
            raise CommandError(f"wanted a clip, or the files of two people; got {', '.join(clip)}")
        (named,) = read_named_clips(["+".join(clip)], options)
        check_outputs(out, [out, *_person_files(out)], named.files)
        is_on_rigs = out.suffix.lower() in OF_A_PERSON
        rigs = own_rigs(named.sources, named.read) if is_on_rigs else []
        files, summary = export_scene(part_of(named.scene, seconds), out, form_of_file, rigs)
    typer.echo(f"{', '.join(map(str, files))}: {summary}")
