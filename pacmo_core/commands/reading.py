"""Options of all commands that read captures, and the people that are read by them.

``--from-unit``, ``--from-up`` and ``--from-fps`` say what a capture is in, ``--to-…`` what is
written. A word is for both people, or ``a=`` and ``b=`` before it make it one person's. Of captures
of several formats each takes the options that its format needs.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from scipy.interpolate import make_interp_spline

from pacmo_core.commands.doubts import doubts
from pacmo_core.data.limits import printable
from pacmo_core.data.names import nearest_first, nearest_names
from pacmo_core.data.posture import UNIT_WORDS
from pacmo_core.data.segments import segments
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.finish.bones import median_lengths
from pacmo_core.formats.base import MAX_DISTANCE, UP_AXES
from pacmo_core.formats.bvh_pairs import PRESETS
from pacmo_core.formats.inference import (
    UNIT_NAMES,
    Inferred,
    implausible,
    infer_settings,
    states_unit_or_axis,
)
from pacmo_core.formats.joint_names import (
    FILE_SUFFIXES,
    JointNames,
    StatedNames,
    name_joints,
    parse_joints,
    stated_body,
)
from pacmo_core.formats.registry import (
    DEFAULT_SETTINGS,
    FORMATS,
    PersonMotion,
    format_of,
    read_partner,
)
from pacmo_core.formats.resample import with_missing
from pacmo_core.formats.rigs import RIGS
from pacmo_core.formats.table import has_person_b
from pacmo_core.project.workspace import CommandError

PEOPLE = ("a", "b")
_PREFIXES = ("a=", "b=")  # of words that are for one person

FormatName = Annotated[
    str | None,
    typer.Option("--format", help=f"{', '.join(FORMATS)}; default: by the suffix of the capture"),
]
Preset = Annotated[
    str | None, typer.Option(help=f"preset of a dataset's BVH files: {', '.join(PRESETS)}")
]
FromUnit = Annotated[
    list[str],
    typer.Option(
        help="metres per unit of the capture, or m, cm, mm, in; a=cm of one person; "
        "default: what it states, else inferred from the bodies"
    ),
]
FromUp = Annotated[
    list[str],
    typer.Option(
        help="up axis of the capture, y or z; a=z of one person; default: what it states, else "
        "inferred from the motion"
    ),
]
FromFps = Annotated[
    list[str],
    typer.Option(help="frame rate of the capture, if it states none or a wrong one; a=120 of one"),
]
Joints = Annotated[
    list[str],
    typer.Option(
        help="names of the capture's joints: a preset (smpl, mixamo, cmu, optitrack, zed34, "
        "kinect25, ...), a file, or MODEL_JOINT=JOINT; a=mixamo of one person; default: the "
        "preset that fits"
    ),
]

ONE_NAME = "skeleton_pos"  # of every file of SBU, and of DuetDance
MIN_LEG_RATIO = 0.5  # of thigh and shin, either by the other; of people 0.8 and more


@dataclass(frozen=True)
class ReadOptions:
    """Options that describe captures, as the command line has them.

    Parameters
    ----------
    form : format; None to infer it from the suffix
    preset : of BVH files
    unit, up, fps, joints : words, each for both people or after ``a=`` or ``b=``
    mixed : whether the captures of the command are of several formats
    with_object : whether the thing that person a of a table holds is a joint, as of the weights
    """

    form: str | None = None
    preset: str | None = None
    unit: Sequence[str] = ()
    up: Sequence[str] = ()
    fps: Sequence[str] = ()
    joints: Sequence[str] = field(default=())
    mixed: bool = False
    with_object: bool = False

    @property
    def describes_files(self) -> bool:
        """Whether an option is given that clips of this project's Parquet do not take."""
        return bool(self.form or self.preset or self.unit or self.up or self.fps)

    def given(self) -> dict[str, object]:
        """Return the values by the names of their options."""
        return {
            "--format": self.form,
            "--preset": self.preset,
            "--from-unit": self.unit,
            "--from-up": self.up,
            "--from-fps": self.fps,
            "--joints": self.joints,
        }

    def format_of(self, file: Path) -> str:
        """Return the format of a file.

        Raises
        ------
        ValueError, KeyError, CommandError
            If there is none of that name or suffix, or the file is a folder.
        """
        if file.is_dir():
            raise CommandError(f"{file}: wanted a file; got a folder: name a capture in it")
        form = self.form or format_of(file)
        if form not in DEFAULT_SETTINGS:
            raise KeyError(f"no format {form!r}; there are {', '.join(DEFAULT_SETTINGS)}")
        return form

    def check(self) -> None:
        """Check names that need no file, so before a model or a capture is read.

        Raises
        ------
        CommandError
            If there is no such preset of BVH files, or of joints.
        """
        if self.preset and self.preset not in PRESETS:
            wanted = nearest_first(self.preset, PRESETS)
            raise CommandError(
                f"--preset: wanted one of {wanted}; got {self.preset!r}{_rig_hint(self.preset)}"
            )
        for person in PEOPLE:
            for word in words_of(self.joints, person):
                _check_joints_word(word)

    def of_captures(self, files: Sequence[Path]) -> "ReadOptions":
        """Return the options of all captures of a command.

        Raises
        ------
        CommandError
            If an option applies to none of them.
        ValueError, KeyError
            If a file is of no format.
        """
        forms = sorted({self.format_of(file) for file in files})
        options = replace(self, mixed=len(forms) > 1)
        known = {name for form in forms for name in options.names(form)}
        for name in ("preset", "unit", "up", "fps"):
            if getattr(self, name) and name not in known:
                option = "--preset" if name == "preset" else f"--from-{name}"
                text = ", ".join(map(str, files))
                raise CommandError(
                    f"{text}: captures of format {' or '.join(forms)} take no {option}"
                    if forms
                    else f"clips of a store take no {option}"
                )
        return options

    def of_person(self, person: str) -> "ReadOptions":
        """Leave out the words that are for the other person alone."""
        of_other = tuple(f"{other}=" for other in PEOPLE if other != person)

        def own(words: Sequence[str]) -> list[str]:
            return [word for word in words if not word.startswith(of_other)]

        return replace(
            self, unit=own(self.unit), up=own(self.up), fps=own(self.fps), joints=own(self.joints)
        )

    def for_both(self) -> list[tuple[str, str]]:
        """List the options and words that are for both people."""
        words = {
            "--joints": self.joints,
            "--from-unit": self.unit,
            "--from-up": self.up,
            "--from-fps": self.fps,
        }
        return [
            (option, word)
            for option, several in words.items()
            for word in several
            if word[:2] not in _PREFIXES
        ]

    def names(self, form: str) -> set[str]:
        """Return the names of settings that an option may give captures of a format.

        Of several formats a table takes none: it states its unit, axis and rate itself, and they
        shall not be those of the files beside it.
        """
        known = DEFAULT_SETTINGS[form] if self.mixed else (f.name for f in fields(FORMATS[form]))
        return set(known)

    def settings(self, form: str, person: str) -> dict[str, Any]:
        """Return the settings of a format that describe one person's capture.

        Raises
        ------
        CommandError
            If a word is not what its option takes.
        """
        self.check()
        words = {
            "unit": _last(self.unit, person, "--from-unit"),
            "up": _last(self.up, person, "--from-up"),
            "fps": _last(self.fps, person, "--from-fps"),
        }
        if words["up"] is not None:
            check_axis(words["up"], "--from-up")
        found: dict[str, Any] = {"preset": self.preset, "up": words["up"]}
        found["object"] = self.with_object or None
        found["unit"] = None if words["unit"] is None else parse_unit(words["unit"], "--from-unit")
        found["fps"] = None if words["fps"] is None else _number(words["fps"], "--from-fps")
        known = self.names(form)
        return {name: found[name] for name in found if name in known and found[name] is not None}


def _rig_hint(preset: str) -> str:
    """Say what names a rig, which is no preset of pairs of files."""
    near = [rig for rig in nearest_names(preset.lower(), RIGS) if rig.startswith(preset.lower())]
    if not near:
        return ""
    return (
        f", a rig: react and vary take --joints {' or '.join(near)}, the other commands need no "
        "names of joints; leave out --preset"
    )


def parse_unit(word: str, option: str) -> float:
    """Read metres a unit, or the name of a unit."""
    return UNIT_WORDS[word] if word in UNIT_WORDS else _number(word, option)


def check_unit(unit: float, option: str) -> None:
    """Refuse metres a unit that no program writes."""
    if not 0 < unit <= MAX_DISTANCE:
        raise CommandError(f"{option} must be > 0 and <= {MAX_DISTANCE:g} metres; got {unit}")


def check_axis(up: str, option: str) -> None:
    """Refuse an upward axis that is neither y nor z."""
    if up not in UP_AXES:
        raise CommandError(f"{option}: wanted {' or '.join(UP_AXES)}; got {up!r}")


def _number(word: str, option: str) -> float:
    try:
        return float(word)
    except ValueError as fault:
        wanted = f"a number or {', '.join(UNIT_WORDS)}" if "unit" in option else "a number"
        raise CommandError(f"{option}: wanted {wanted}; got {word}") from fault


def words_of(words: Sequence[str], person: str) -> list[str]:
    """Select the words that are for a person: those for both, and those after ``a=`` or ``b=``."""
    split = [word.partition("=") if word[:2] in _PREFIXES else ("", "", word) for word in words]
    return [word for who, _, word in split if who in ("", person)]


def _check_joints_word(word: str) -> None:
    is_file = Path(word).suffix.lower() in FILE_SUFFIXES
    if word not in RIGS and "=" not in word and not is_file:
        files = ", ".join(FILE_SUFFIXES)
        raise CommandError(
            f"--joints: no preset of joints {word!r}; wanted {nearest_first(word, RIGS)}; "
            f"a file {files}; or MODEL_JOINT=JOINT"
        )


def _last(words: Sequence[str], person: str, option: str) -> str | None:
    """Return the word of a person: one that names the person before one for both."""
    own = [word[2:] for word in words if word.startswith(f"{person}=")]
    both = [word for word in words if word[:2] not in _PREFIXES]
    if len(own) > 1 or len(both) > 1:
        raise CommandError(f"{option}: wanted one value a person; got {', '.join(words)}")
    return next(iter([*own, *both]), None)


@dataclass(frozen=True)
class Source:
    """Where one person is.

    Parameters
    ----------
    file : a capture
    label : ``a`` or ``b``, whose options apply
    person : ``a`` or ``b`` of a file of two people; None where it holds one
    """

    file: Path
    label: str
    person: str | None


@dataclass(frozen=True)
class ReadPerson:
    """One person, and how the file was read.

    Parameters
    ----------
    motion : of the person
    settings : of the format: those that were given, and those that were inferred
    """

    motion: PersonMotion
    settings: Mapping[str, Any]


def read_people(sources: Sequence[Source], options: ReadOptions, clip: str) -> list[ReadPerson]:
    """Read people by the options; infer what neither they nor the files state, and say so.

    Raises
    ------
    FormatError, ValueError, KeyError, CommandError
        If a file cannot be read, a unit or axis can neither be read nor inferred, or gives a person
        of impossible stature or posture.
    """
    forms = [options.format_of(source.file) for source in sources]
    _check_clip(sources, clip)
    settings = [
        options.settings(form, source.label) for form, source in zip(forms, sources, strict=True)
    ]
    names = [_stated_names(source, options) for source in sources]
    inferred = [
        infer_settings(source.file, form, given, of_joints)
        for source, form, given, of_joints in zip(sources, forms, settings, names, strict=True)
    ]
    found = _complete([source.file for source in sources], inferred)
    used = [{**given, **more} for given, more in zip(settings, found, strict=True)]
    people = [
        read_partner(source.file, form, of_file, person=source.person, clip=clip)
        for source, form, of_file in zip(sources, forms, used, strict=True)
    ]
    _check_one_axis(sources, people, settings, inferred)
    if any(states_unit_or_axis(FORMATS[form]) for form in forms):
        others = _other_people(sources, forms, used, clip)
        n_each = 1 + len(others) // len(people)
        check_plausible(
            n_each * [*sources], [*people, *others], n_each * [*map(_stated_up, used)],
            n_each * names,
        )  # fmt: skip
    for line in _inference_lines(sources, inferred, found):
        typer.echo(printable(line))
    for line in doubts([source.file for source in sources], people):
        typer.echo(printable(line), err=True)
    whole = [_filled(person) for person in people]
    lines = [
        _missing_line(source.file, person, len(filled.times) - len(person.times))
        for source, person, filled in zip(sources, people, whole, strict=True)
    ]
    for line in dict.fromkeys(filter(None, lines)):
        typer.echo(printable(line), err=True)
    return [ReadPerson(person, of_file) for person, of_file in zip(whole, used, strict=True)]


def _other_people(
    sources: Sequence[Source], forms: Sequence[str], used: Sequence[dict[str, Any]], clip: str
) -> list[PersonMotion]:
    """Return who else is in a table of whom one person is read: two show the axis that is up."""
    (source, *more), form = sources, forms[0]
    if more or form != "table" or source.person is None or not has_person_b(source.file):
        return []
    other = PEOPLE[1 - PEOPLE.index(source.person)]
    return [read_partner(source.file, form, used[0], person=other, clip=clip)]


def _missing_line(file: Path, person: PersonMotion, n_missing: int) -> str:
    """Say how many frames are missing in a capture of times; empty if none is."""
    if not n_missing:
        return ""
    first = person.times[np.diff(person.times).argmax()] - person.times[0]
    return (
        f"{file}: {n_missing} frames are missing, most after {first:.3g} s; "
        "they are filled straight between those around"
    )


def _filled(person: PersonMotion) -> PersonMotion:
    """Fill missing frames: a file of a frame rate would play those that follow too early.

    Straight between the frames around: a curve through noisy frames swings in a long gap.
    """
    at = with_missing(person.times)
    if len(at) == len(person.times):
        return person
    filled = make_interp_spline(person.times, person.motion.astype(np.float64), k=1)(at)
    return replace(person, times=at, motion=filled.astype(np.float32))


def _check_clip(sources: Sequence[Source], clip: str) -> None:
    """Refuse the name of a clip for files that hold one capture."""
    single = [source.file for source in sources if source.file.suffix.lower() != ".mat"]
    if clip and single:
        raise CommandError(
            f"{single[0]}: holds one capture; --clip is for .mat and .parquet files; got {clip}"
        )


def _check_one_axis(
    sources: Sequence[Source],
    people: Sequence[PersonMotion],
    given: Sequence[Mapping[str, Any]],
    inferred: Sequence[Inferred],
) -> None:
    """Refuse to infer two upward axes for two people of one rig, of whom one lies.

    Files of one program have one axis, and a trunk along another one is that of a person who lies:
    which of the two it is, their motions do not show.
    """
    axes = [
        {**of_file.settings, **words}.get("up")
        for words, of_file in zip(given, inferred, strict=True)
    ]
    is_guessed = any("up" in of_file.settings for of_file in inferred)
    of_one_rig = len({person.skeleton.joints for person in people}) == 1
    if is_guessed and of_one_rig and len({*axes} - {None}) > 1:
        found = " and ".join(
            f"{axis} for {source.file}" for source, axis in zip(sources, axes, strict=True)
        )
        raise CommandError(
            f"the spines of the two people are along different axes, {found}, as where one lies: "
            f"give --from-up, such as --from-up {axes[0]}, or where two programs wrote them "
            f"--from-up a={axes[0]} --from-up b={axes[1]}"
        )


def _complete(files: Sequence[Path], inferred: Sequence[Inferred]) -> list[dict[str, Any]]:
    """Fill in what one person's motion does not show by what the other's does."""
    result = []
    for file, of_file in zip(files, inferred, strict=True):
        settings = dict(of_file.settings)
        for name, value in of_file.settings.items():
            others = {other.settings.get(name) for other in inferred} - {None}
            if value is None and len(others) == 1:
                settings[name] = others.pop()
            elif value is None:
                what = {"unit": "unit", "up": "upward axis"}[name]
                if of_file.missing:
                    limbs = ", ".join(limb.replace("_", " ") for limb in of_file.missing)
                    raise CommandError(
                        f"{file}: not recognised among its joints: {limbs}; and it states no "
                        f"{what}: name its joints (--joints of react, vary), or "
                        f"give --from-{name}"
                    )
                raise CommandError(
                    f"{file}: states no {what}, and its motion does not show it: give --from-{name}"
                )
        result.append(settings)
    return result


def _inference_lines(
    sources: Sequence[Source], inferred: Sequence[Inferred], found: Sequence[Mapping[str, Any]]
) -> list[str]:
    """Say what was inferred, in one line for all files of which it is the same."""
    files_by_text: dict[str, list[str]] = {}
    options: dict[str, list[str]] = {}
    for source, of_file, settings in zip(sources, inferred, found, strict=True):
        if settings:
            words = {
                "unit": lambda value: UNIT_NAMES.get(value, f"{value:g} m"),
                "up": lambda value: f"{value} up",
            }
            text = ", ".join(words[name](value) for name, value in settings.items())
            files = files_by_text.setdefault(text, [])
            stature = (
                "" if of_file.stature is None else f" ({of_file.stature:.2f} m tall by the legs)"
            )
            if f"{source.file}{stature}" not in files:
                files.append(f"{source.file}{stature}")
            options[text] = [f"--from-{name}" for name in settings]
    return [
        f"inferred for {' and '.join(files)}: {text}; {' and '.join(options[text])} override"
        for text, files in files_by_text.items()
    ]


def _stated_up(settings: Mapping[str, Any]) -> str | None:
    """Return the upward axis by which a file was read; None if it is in the file."""
    preset: str = settings.get("preset", "pair")
    return settings.get("up") or PRESETS[preset].up


def check_plausible(
    sources: Sequence[Source],
    people: Sequence[PersonMotion],
    stated: Sequence[str | None],
    names: Sequence[StatedNames],
) -> None:
    """Refuse a person whom no unit and axis that are right would give.

    Parameters
    ----------
    stated : the upward axis of each file; None if it is in the file
    names : of the joints of each, if the user states them

    Raises
    ------
    CommandError
        With the file and the reason.
    """
    bodies = [
        stated_body(person.skeleton, person.motion, of_joints)
        for person, of_joints in zip(people, names, strict=True)
    ]
    fault = implausible(bodies, stated)
    if fault:
        number, reason = fault
        raise CommandError(f"{sources[number].file}: {reason} (--from-unit, --from-up)")


def to_model_joints(
    people: Sequence[PersonMotion],
    skeleton: Skeleton,
    sources: Sequence[Source],
    options: ReadOptions,
) -> list[PersonMotion]:
    """Select the joints of a model in captures, as ``name_model_joints`` finds them; say how."""
    names = [
        name_model_joints(person, skeleton, source, options, estimates=True)
        for person, source in zip(people, sources, strict=True)
    ]
    say_names([(source.file, of.description) for source, of in zip(sources, names, strict=True)])
    named = [
        replace(person, skeleton=skeleton, motion=of.apply(person.motion))
        for person, of in zip(people, names, strict=True)
    ]
    for source, person in zip(sources, named, strict=True):
        check_legs(source.file, person)
    return named


def capture_name(file: Path) -> str:
    """Name a capture by its file, or by its folders where a dataset gives all files one name."""
    return "_".join(file.absolute().parts[-4:-1]) if file.stem == ONE_NAME else file.stem


def check_legs(file: Path, person: PersonMotion) -> None:
    """Refuse legs of which a thigh and a shin have no human proportion.

    Of rigs of equal names some name a joint by the bone that ends there, some by the one that
    begins.
    """
    names = [segment.name for segment in segments(person.skeleton)]
    lengths = dict(zip(names, median_lengths(person.motion, person.skeleton), strict=True))
    for side in ("left", "right"):
        thigh, shin = (lengths.get(f"{side}_{name}") for name in ("thigh", "shin"))
        if thigh is None or shin is None:
            continue
        if min(thigh, shin) < MIN_LEG_RATIO * max(thigh, shin):
            raise CommandError(
                f"{file}: a {side} thigh of {thigh:.2f} m and shin of {shin:.2f} m: its joints are "
                "not where their names say, as where they name bones that begin there; wanted "
                "--joints cmu_bones for CMU's bones (of a rig, --joints b=cmu_bones), or hips, "
                "knees and ankles by name, such as --joints left_knee=ltibia"
            )


def name_model_joints(
    person: PersonMotion,
    skeleton: Skeleton,
    source: Source,
    options: ReadOptions,
    *,
    estimates: bool = False,
) -> JointNames:
    """Find the joints of a model, by name, by a preset or as the options state them.

    A motion may have estimated joints; a rig, which a motion is written on, may not.

    Raises
    ------
    CommandError
        If some are not named in the capture: with the nearest.
    """
    stated = _stated_names(source, options)
    try:
        return name_joints(person.skeleton, skeleton, stated, estimates=estimates)
    except ValueError as fault:
        raise CommandError(f"{source.file}: {fault}") from fault


def _stated_names(source: Source, options: ReadOptions) -> StatedNames:
    """Read what the options state about the names of joints of one person."""
    try:
        return parse_joints(words_of(options.joints, source.label))
    except ValueError as fault:
        raise CommandError(f"{source.file}: {fault}") from fault


def say_names(described: Sequence[tuple[Path, str]]) -> None:
    """Say how joints were named, once for files in which they are named alike."""
    for text in dict.fromkeys(text for _, text in described if text):
        files = dict.fromkeys(str(file) for file, of_file in described if of_file == text)
        typer.echo(printable(f"{' and '.join(files)}: {text}"))
