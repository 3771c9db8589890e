"""Captures of two people: read from any format, written in the same format."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from tempfile import TemporaryFile
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray

from pacmo_core.commands.bvh_fidelity import Fidelity, pair_targets, with_end_sites
from pacmo_core.commands.reading import (
    PEOPLE,
    ReadOptions,
    ReadPerson,
    Source,
    capture_name,
    check_axis,
    check_unit,
    parse_unit,
    read_people,
)
from pacmo_core.data.interaction import Interaction, Motion
from pacmo_core.data.limits import printable
from pacmo_core.data.names import file_stem, nearest_names
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.formats.bvh import read_bvh
from pacmo_core.formats.bvh_pairs import BvhPairs
from pacmo_core.formats.inference import UNIT_NAMES
from pacmo_core.formats.registry import (
    DEFAULT_SETTINGS,
    ONE_PERSON_FORMATS,
    PersonMotion,
    read_partner,
    select_person,
)
from pacmo_core.formats.resample import frame_rate, from_y_up, resample
from pacmo_core.formats.table_parquet import is_clip_file
from pacmo_core.formats.write_bvh import BvhTargets, format_bvh, rewrite_bvh
from pacmo_core.interaction_mesh import Scene
from pacmo_core.project.workspace import CommandError
from pacmo_core.store.files import write_text
from pacmo_core.store.motions import read_motion, read_names, write_motions

MIN_BONE_LENGTH = 1e-3  # metres: a bone that is shorter in every frame has no length


ToUnit = Annotated[
    str | None,
    typer.Option(
        help="metres per unit of BVH files, or m, cm, mm, in; default: m, or that of --rig"
    ),
]
ToUp = Annotated[
    str | None,
    typer.Option(help="up axis of BVH files, y or z; default: y, or that of --rig"),
]
ToOtherUnit = Annotated[
    str | None,
    typer.Option(
        "--to-unit",
        help="metres per unit, or m, cm, mm, in, of BVH files that are not on the rig of the "
        "capture; default: m",
    ),
]
ToOtherUp = Annotated[
    str | None,
    typer.Option(
        "--to-up",
        help="up axis, y or z, of BVH files that are not on the rig of the capture; default: y",
    ),
]


@dataclass(frozen=True)
class OutputSpace:
    """Metres per unit and up axis of BVH files that are not on the rig of a capture."""

    unit: float = 1.0
    up: str = "y"

    def __str__(self) -> str:
        """Name both, as ``centimetres, y up``."""
        return f"{UNIT_NAMES.get(self.unit, f'units of {self.unit:g} m')}, {self.up} up"


def bvh_text(
    person: PersonMotion, aims: Motion, weights: NDArray[np.float64], space: OutputSpace
) -> str:
    """Write one person's BVH file on the joints of the motion.

    Parameters
    ----------
    aims : (T, J, 3) float32, metres, y up, in place of the person's own motion
    weights : (T, J), of the squared distances to them
    """
    in_units = (from_y_up(aims, space.up) / space.unit).astype(np.float32)
    return format_bvh(in_units, frame_rate(person.times), person.skeleton, weights)


@dataclass(frozen=True)
class TwoPersonCapture:
    """The motions of two people at the same times.

    Parameters
    ----------
    name : of the capture
    files : one of both people, or those of person a and person b
    settings : with which each person's file was read
    people : person a and person b, without bones of length zero
    as_read : both with them, whose joints have names too
    keeps_hierarchy : whether a BVH file is written in the hierarchy, unit and axes of the input
    space : of BVH files that are not
    joints_of : what else a BVH file has the joints of
    bodies : both people with all joints of their files, and the End Sites of BVH files; None of a
        clip of a Parquet file, whose joints are all
    """

    name: str
    files: tuple[Path, ...]
    settings: tuple[Mapping[str, Any], ...]
    people: tuple[PersonMotion, PersonMotion]
    as_read: tuple[PersonMotion, PersonMotion]
    keeps_hierarchy: bool = True
    space: OutputSpace = OutputSpace()
    joints_of: str = "capture"
    bodies: tuple[PersonMotion, PersonMotion] | None = None

    def file_of(self, number: int) -> Path:
        """Return the file of person a, 0, or b, 1."""
        return self.files[number] if len(self.files) == 2 else self.files[0]

    def is_on_own_rig(self, number: int) -> bool:
        """Whether a BVH file of a person is written on the rig of the capture."""
        return self.keeps_hierarchy and self.file_of(number).suffix.lower() == ".bvh"

    def in_space(self, to_unit: str | None, to_up: str | None, out: Path) -> "TwoPersonCapture":
        """Return the capture with the unit and axis of BVH files; None for metres, y up.

        Raises
        ------
        CommandError
            If they are none, or nothing would be written in them.
        """
        unit = 1.0 if to_unit is None else parse_unit(to_unit, "--to-unit")
        space = OutputSpace(unit, "y" if to_up is None else to_up)
        check_unit(space.unit, "--to-unit")
        check_axis(space.up, "--to-up")
        if (to_unit or to_up) and is_parquet(out):
            raise CommandError(
                f"{out}: Parquet is always metres, y up; leave out --to-unit, --to-up"
            )
        if (to_unit or to_up) and all(self.is_on_own_rig(number) for number in range(2)):
            raise CommandError(
                f"{out}: BVH is written on the rig of the capture, in its unit and axes; leave "
                "out --to-unit, --to-up (pacmo export converts them)"
            )
        return replace(self, space=space)

    def rig_line(self, out: Path) -> str:
        """Say on which rig, and in what, BVH files are; nothing of Parquet."""
        own = [self.is_on_own_rig(number) for number in range(2)]
        if is_parquet(out):
            return ""
        if all(own):
            return "written on the rig of the capture, in its unit and axes"
        whom = "" if not any(own) else f"person {PEOPLE[own.index(False)]} "
        return (
            f"{whom}written with the joints of the {self.joints_of}, on no rig of the capture, in "
            f"{self.space} (--to-unit, --to-up)"
        )

    @property
    def whole(self) -> tuple[PersonMotion, PersonMotion]:
        """Both people with all that is in their files."""
        return self.bodies or self.people

    @property
    def scene(self) -> Scene:
        """Both people as input of the solver."""
        a, b = self.people
        return Scene((a.motion, b.motion), (a.skeleton, b.skeleton), frame_rate(a.times))

    def moved(self, motions: tuple[Motion, Motion]) -> "TwoPersonCapture":
        """Return the capture with other motions of the same people."""
        a, b = (
            replace(person, motion=motion)
            for person, motion in zip(self.people, motions, strict=True)
        )
        return replace(self, people=(a, b))


def read_two_people(files: tuple[Path, ...], options: ReadOptions, clip: str) -> TwoPersonCapture:
    """Read one file of two people, or two files of one person each.

    Raises
    ------
    CommandError
        If the files are not those of two people at the same times.
    """
    first = files[0]
    if names_clips(first, clip):
        if not clip:
            raise CommandError(f"{first}: name the clip with --clip: {some_clips(first)}")
        if len(files) > 1 or options.describes_files:
            raise CommandError(f"{first}: wanted one file, --clip, and no option of other formats")
        pair = read_clip(first, clip)
        people = [select_person(pair, person, clip) for person in PEOPLE]
        return _make_capture(clip, files, ({}, {}), people)
    for file in files:
        form = options.format_of(file)
        if (form in ONE_PERSON_FORMATS) != (len(files) == 2):
            wanted = "two: wanted one file"
            if form in ONE_PERSON_FORMATS:
                wanted = "one person: wanted two files"
            raise CommandError(f"{file}: a file of format {form} holds {wanted}; got {len(files)}")
    read = read_people(two_sources(files), options.of_captures(files), clip)
    settings = tuple(person.settings for person in read)
    text = " and ".join(str(file) for file in files)
    a, b = on_one_clock(read[0].motion, read[1].motion, text)
    capture = _make_capture(clip or capture_name(first), files, settings, [a, b])
    resampled = a is not read[0].motion or b is not read[1].motion
    bodies = [
        _at_times(_whole(file, of_file, options.format_of(file)), person.times)
        for file, of_file, person in zip(files * (2 // len(files)), read, (a, b), strict=True)
    ]
    return replace(capture, keeps_hierarchy=not resampled, bodies=(bodies[0], bodies[1]))


def _whole(file: Path, read: ReadPerson, form: str) -> PersonMotion:
    return with_end_sites(file, read.motion, read.settings) if form == "bvh" else read.motion


def _at_times(person: PersonMotion, times: NDArray[np.float64]) -> PersonMotion:
    if np.array_equal(person.times, times):
        return person
    return replace(person, times=times, motion=resample(person.motion, person.times, times))


def read_clip(file: Path, name: str) -> Interaction:
    """Read a clip of a Parquet file.

    Raises
    ------
    CommandError
        If there is none of that name: with the nearest names.
    StoreError
        If the file is damaged.
    """
    try:
        return read_motion(file, name)
    except KeyError as fault:
        near = nearest_names(name, read_names(file))
        hint = f"; the nearest: {', '.join(near)}" if near else ""
        raise CommandError(
            f"{file}: no clip {name}{hint} (pacmo clips {file} lists them)"
        ) from fault


MIN_PERSON_DISTANCE = 0.1  # metres, as the quality limits of params.yaml have it
MAX_NAMED = 3  # clips in a message


def some_clips(file: Path, before: str = "") -> str:
    """Name a few of the clips of a Parquet file, each after some text, and how to list all."""
    names = read_names(file)
    shown = ", ".join(f"{before}{name}" for name in names[:MAX_NAMED])
    more = f" ... ({len(names)} in all: pacmo clips {file})" if names[MAX_NAMED:] else ""
    return f"{shown}{more}" if names else f"{file} has none"


def check_two_people(a: PersonMotion, b: PersonMotion, files: Sequence[Path]) -> None:
    """Refuse one person's motion where two people's are wanted.

    One body that was fitted twice, as AMASS has it, differs by centimetres.

    Parameters
    ----------
    files : from which both were read
    """
    if a.skeleton.joints != b.skeleton.joints or a.motion.shape != b.motion.shape:
        return
    apart = float(np.linalg.norm(a.motion - b.motion, axis=-1).mean())
    if apart < MIN_PERSON_DISTANCE:
        text = " and ".join(str(file) for file in files)
        got = "the same motion twice" if len(files) == 2 else "one person"
        if apart:
            got += (
                f": joints are {100 * apart:.1f} cm from their counterparts on average, wanted at "
                f"least {100 * MIN_PERSON_DISTANCE:.0f} cm"
            )
        raise CommandError(f"{text}: wanted the motions of two people; got {got}")


def two_sources(files: Sequence[Path]) -> list[Source]:
    """Return where the two people of one file, or of two, are."""
    if len(files) == 2:
        return [Source(file, label, None) for file, label in zip(files, PEOPLE, strict=True)]
    return [Source(files[0], label, label) for label in PEOPLE]


def on_one_clock(a: PersonMotion, b: PersonMotion, text: str) -> tuple[PersonMotion, PersonMotion]:
    """Resample the person of the higher frame rate at the times of the other, and say so.

    Equal rates are left alone. Both are cut to the time that they have in common.

    Raises
    ------
    CommandError
        If their frames are not at the same times.
    """
    rates = [frame_rate(person.times) for person in (a, b)]
    if np.isclose(rates[0], rates[1], rtol=1e-4):
        _check_same_times(a, b, text)
        return a, b
    slow, fast = (a, b) if rates[0] < rates[1] else (b, a)
    at = slow.times[slow.times <= fast.times[-1] + 0.1 / max(rates)]  # rates of files are rounded
    if len(at) < 2:
        raise CommandError(f"{text}: wanted two frames or more at the same time")
    cut = replace(slow, times=at, motion=slow.motion[: len(at)])
    same = replace(fast, times=at, motion=resample(fast.motion, fast.times, at))
    said = f"{rate_text(rates[0])} and {rate_text(rates[1])} frames a second"
    typer.echo(printable(f"{text}: {said}: both at {rate_text(min(rates))}"))
    return (cut, same) if slow is a else (same, cut)


def rate_text(fps: float) -> str:
    """Name a frame rate as it was meant (see ``meant_rate``)."""
    return f"{meant_rate(fps):.6g}"


def meant_rate(fps: float) -> float:
    """Return a frame rate as it was meant: a Frame Time of 0.033333 s is 30 frames a second."""
    whole = round(fps)
    return whole if np.isclose(fps, whole, rtol=1e-4, atol=0) else fps


def meant_times(times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return ``(T,)`` seconds: the times of frames at the rate that was meant.

    A rate that is a multiple of it keeps the frames of a file, whose Frame Time is rounded.
    """
    fps = frame_rate(times)
    meant: NDArray[np.float64] = times[0] + (times - times[0]) * (fps / meant_rate(fps))
    return meant


def _check_same_times(a: PersonMotion, b: PersonMotion, text: str) -> None:
    if len(a.times) != len(b.times):
        raise CommandError(
            f"{text}: {len(a.times)} frames of one, {len(b.times)} of the other; "
            "wanted two people of one take; pacmo export --seconds cuts a part of either out"
        )
    if not np.allclose(a.times, b.times, rtol=1e-4):
        ends = f"{a.times[-1]:g} s and {b.times[-1]:g} s"
        raise CommandError(f"{text}: not at the same times; they end at {ends}")


def names_clips(file: Path, clip: str) -> bool:
    """Return whether a capture is a Parquet file of clips, not one of the formats' files."""
    return file.suffix.lower() == ".parquet" and (bool(clip) or is_clip_file(file))


def is_parquet(out: Path) -> bool:
    """Return whether the output is one Parquet file, not a folder of that name."""
    return out.suffix.lower() == ".parquet" and not out.is_dir()


def check_output(duo: TwoPersonCapture, out: Path) -> None:
    """Reject an output without a known suffix, or one that would overwrite the capture."""
    suffix = out.suffix.lower()
    if suffix not in (".parquet", ".bvh", "") and not out.is_dir():
        raise CommandError(f"{out}: wanted a .parquet or .bvh file, or a folder for BVH files")
    if suffix == ".parquet" and duo.people[0].skeleton != duo.people[1].skeleton:
        raise CommandError(
            f"{out}: Parquet holds two people of one skeleton; name a folder for BVH"
        )
    outputs = [out] if suffix == ".parquet" else _output_files(duo, out)
    check_outputs(out, outputs, duo.files)


def check_outputs(out: Path, outputs: Iterable[Path], inputs: Iterable[Path]) -> None:
    """Refuse an output ``out`` of which a file is one that is read, or where none can be written.

    Raises
    ------
    CommandError
        Naming the file, or the nearest folder that exists and takes no file.
    """
    files = list(outputs)
    for folder in dict.fromkeys(file.absolute().parent for file in files):
        _check_folder(folder, out)
    read = {file.resolve() for file in inputs}
    for file in files:
        if file.resolve() in read:
            raise CommandError(f"{out}: this would overwrite {file}; name another output")


def _check_folder(folder: Path, out: Path) -> None:
    """Refuse a folder of outputs in which, or in the nearest above it, no file can be made."""
    nearest = folder
    try:
        nearest = next(parent for parent in (folder, *folder.parents) if parent.exists())
        # Neither permissions nor the kind of file system tell whether a file can be made.
        with TemporaryFile(dir=nearest):
            pass
    except OSError as fault:
        raise CommandError(f"{out}: {nearest} takes no file: {fault.strerror}") from fault


@dataclass(frozen=True)
class WrittenCapture:
    """Files, and the motion in them.

    Parameters
    ----------
    files : that were written
    people : read back from the files; BVH files hold bones of constant length
    fidelity : of the files
    bodies : the same people with all joints and End Sites of BVH files; None of Parquet
    """

    files: list[Path]
    people: tuple[PersonMotion, PersonMotion]
    fidelity: Fidelity
    bodies: tuple[PersonMotion, PersonMotion] | None = None


def write_two_people(
    duo: TwoPersonCapture,
    scales: tuple[NDArray[np.float64], NDArray[np.float64]],
    label: str,
    out: Path,
    sample: str = "",
) -> WrittenCapture:
    """Write both people, and read back what was written.

    Parameters
    ----------
    scales : of the bones of each person, from which the offsets of BVH files follow
    label : name of the variation in a Parquet file
    sample : in messages, where there are several
    """
    a, b = duo.people
    if is_parquet(out):
        with write_motions(out, a.skeleton) as writer:
            times = a.times - a.times[0]
            pair = Interaction(a.skeleton, times, a.motion, b.motion)
            writer.add(f"{duo.name}~{label}", pair)
        return WrittenCapture([out], duo.people, Fidelity())
    files, bodies = _output_files(duo, out), list[PersonMotion]()
    for number, (aims, weights) in enumerate(pair_targets(a, b)):
        aimed = replace(duo.people[number], motion=aims)
        targets = PersonTargets(aimed, weights, scales[number])
        bodies.append(_write_person(duo, number, targets, files[number]))
    written = [
        replace(person, motion=body.select_joints(person.skeleton).motion)
        for person, body in zip(duo.people, bodies, strict=True)
    ]
    fidelity = Fidelity.of(duo.people, written, files, sample)
    return WrittenCapture(files, (written[0], written[1]), fidelity, (bodies[0], bodies[1]))


@dataclass(frozen=True)
class PersonTargets:
    """What a BVH file shall hold.

    Parameters
    ----------
    person : the motion
    weights : (T, J), of the squared error of each joint
    bone_scales : (E,), bone lengths relative to the capture's
    """

    person: PersonMotion
    weights: NDArray[np.float64]
    bone_scales: NDArray[np.float64]


def _write_person(
    duo: TwoPersonCapture, number: int, targets: PersonTargets, out: Path
) -> PersonMotion:
    """Write a BVH file, in the hierarchy of the input if that is BVH; return all it holds."""
    person, file = targets.person, duo.file_of(number)
    settings: dict[str, Any] = asdict(duo.space)
    if duo.is_on_own_rig(number):
        pairs = BvhPairs(**{**DEFAULT_SETTINGS["bvh"], **duo.settings[number]})
        settings = {"unit": pairs.metres(file), "up": pairs.up_axis}
        write_text(out, _rewritten(file, pairs, targets))
    else:
        write_text(out, bvh_text(person, person.motion, targets.weights, duo.space))
    return read_file(out, settings, has_ends=duo.is_on_own_rig(number))


def read_file(file: Path, settings: Mapping[str, Any], *, has_ends: bool) -> PersonMotion:
    """Read all joints of a BVH file that was written.

    Parameters
    ----------
    has_ends : whether to add its End Sites: those of a rig are toes and fingertips, others were
        made up by the writer, as the format wants them
    """
    person = read_partner(file, "bvh", settings, person=None, clip="")
    return with_end_sites(file, person, settings) if has_ends else person


def _output_files(duo: TwoPersonCapture, out: Path) -> list[Path]:
    """Return the BVH files: in a folder under the names of the input, else NAME_A and NAME_B."""
    if out.suffix.lower() == ".bvh" and not out.is_dir():
        return [out.with_name(f"{out.stem}_{person.upper()}.bvh") for person in PEOPLE]
    if all(file.suffix.lower() == ".bvh" for file in duo.files):
        names = [file.name for file in duo.files]
        if names[0] != names[1]:
            return [out / name for name in names]
    stem = file_stem(duo.name)
    return [out / f"{stem}_{person.upper()}.bvh" for person in PEOPLE]


def _rewritten(file: Path, pairs: BvhPairs, targets: PersonTargets) -> str:
    """Write a motion in the hierarchy, unit and axes of its BVH file."""
    bvh, person = read_bvh(file), targets.person
    metres = pairs.metres(file)
    positions = from_y_up(person.motion, pairs.up_axis).astype(np.float64) / metres
    joints = [bvh.joints.index(name) for name in person.skeleton.joints]
    scales = np.ones(len(bvh.joints))
    bones = person.skeleton.bones[:, 1].tolist()
    for child, scale in zip(bones, targets.bone_scales.tolist(), strict=True):
        scales[joints[child]] = scale
    for end in bvh.end_sites:
        scales[end] = scales[bvh.parents[end]]
    return rewrite_bvh(file, bvh, BvhTargets(joints, positions, targets.weights), scales)


def _make_capture(
    name: str,
    files: tuple[Path, ...],
    settings: tuple[Mapping[str, Any], ...],
    people: list[PersonMotion],
) -> TwoPersonCapture:
    a, b = (_without_zero_bones(person) for person in people)
    check_two_people(a, b, files)
    return TwoPersonCapture(name, files, settings, (a, b), (people[0], people[1]))


def _without_zero_bones(person: PersonMotion) -> PersonMotion:
    """Remove joints that coincide with their parent in every frame, as some programs write them."""
    body = person.skeleton
    parent, child = body.bones.T
    lengths = np.linalg.norm(person.motion[:, child] - person.motion[:, parent], axis=-1)
    empty = child[(lengths < MIN_BONE_LENGTH).all(axis=0)]
    if not len(empty):
        return person
    kept: Skeleton = body.without(body.joints[joint] for joint in empty)
    rows = body.indices(kept.joints)
    return PersonMotion(kept, person.times, np.ascontiguousarray(person.motion[:, rows]))
