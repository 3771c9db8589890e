"""``pacmo augment``: retarget two people's motion to other bodies by InteractionMesh."""

import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from pacmo_core.augmentation.bodies import (
    PROFILES,
    UNIFORM,
    BodyBones,
    measure_body,
    profile_scales,
    segment_scales,
)
from pacmo_core.augmentation.filter import VariationLimits
from pacmo_core.augmentation.run import report_measurements
from pacmo_core.commands.captures import (
    ToOtherUnit,
    ToOtherUp,
    TwoPersonCapture,
    check_output,
    is_parquet,
    read_two_people,
    write_two_people,
)
from pacmo_core.commands.measured import measure_written, write_variation_page
from pacmo_core.commands.reading import (
    PEOPLE,
    FormatName,
    FromFps,
    FromUnit,
    FromUp,
    Preset,
    ReadOptions,
)
from pacmo_core.data.interaction import Motion
from pacmo_core.data.names import nearest_first
from pacmo_core.formats.base import FormatError
from pacmo_core.interaction_mesh import Settings, prepare, retarget
from pacmo_core.project.workspace import (
    PARAMS,
    CommandError,
    errors_in_one_line,
    in_project,
    one_line,
)
from pacmo_core.store.files import StoreError, default_params_file


@dataclass(frozen=True)
class SolverSection:
    """The section ``augment``, as far as the command uses it: solver and limits."""

    solver: Settings
    limits: VariationLimits


def present_params() -> Path:
    """Return the parameters of the project if there is one, else those of the package."""
    params = in_project(PARAMS)
    return params if params.is_file() else default_params_file()


def read_solver_section(params: Path) -> SolverSection:
    """Read the section ``augment``.

    Raises
    ------
    CommandError
        If there is no such file or section, or a value is invalid.
    """
    if params.is_dir():
        raise CommandError(f"{params}: a folder; wanted a file, such as {params / PARAMS.name}")
    if not params.is_file():
        raise CommandError(f"no {params}: give --params, such as a params.yaml")
    try:
        content = YAML(typ="safe").load(params)
    except YAMLError as fault:
        raise CommandError(f"{params}: not YAML: {' '.join(str(fault).split())}") from fault
    section = content.get("augment") if isinstance(content, dict) else None
    if not isinstance(section, dict):
        raise CommandError(f"{params}: no section augment")
    try:
        return TypeAdapter(SolverSection).validate_python(section)
    except ValidationError as fault:
        first = fault.errors()[0]
        key = ".".join(map(str, ("augment", *first["loc"])))
        raise CommandError(f"{params}, {key}: {first['msg']}, got {first['input']!r}") from fault


First = Annotated[Path, typer.Argument(help="a capture of two people, or of person a")]
Second = Annotated[
    Path | None, typer.Argument(help="the capture of person b, if each person has a file")
]
Out = Annotated[Path, typer.Option(help="a folder or FILE.bvh for BVH files, or FILE.parquet")]
AScale = Annotated[list[str], typer.Option("--a-scale", help="SEGMENT=SCALE of person a")]
BScale = Annotated[list[str], typer.Option("--b-scale", help="SEGMENT=SCALE of person b")]
Profile = Annotated[list[str], typer.Option("--profile", help="PERSON=NAME: b=child, a=long_arms")]
Profiles = Annotated[
    list[str],
    typer.Option(
        "--profile", help="PERSON=NAME: b=child; b=child,tall_adult for several, each in a folder"
    ),
]
Clip = Annotated[str, typer.Option(help="name of the clip in a .parquet or .mat file")]
Params = Annotated[
    Path | None,
    typer.Option(
        help="file with the settings of the solver, in section augment; default: params.yaml of "
        "this folder, or of the package"
    ),
]

Scales = NDArray[np.float64]
ADVICE = (
    "look at these frames in the page; a smaller change of the bodies (--a-scale, --b-scale) keeps "
    "distances better"
)
SCALES = 0.3, 3.0  # of a segment: beyond them no body of a person results


def augment(  # noqa: PLR0913  # typer reads the options off the signature
    first: First,
    second: Second = None,
    *,
    out: Out,
    a_scale: AScale = [],  # noqa: B006  # typer copies it
    b_scale: BScale = [],  # noqa: B006
    profile: Profiles = [],  # noqa: B006
    clip: Clip = "",
    form: FormatName = None,
    preset: Preset = None,
    from_unit: FromUnit = [],  # noqa: B006
    from_up: FromUp = [],  # noqa: B006
    from_fps: FromFps = [],  # noqa: B006
    params: Params = None,
    to_unit: ToOtherUnit = None,
    to_up: ToOtherUp = None,
) -> None:
    """Retarget two people's motion to other bodies; contacts and near distances are preserved.

    pacmo augment DUO_A.bvh DUO_B.bvh --b-scale left_forearm=1.2 --out other

    pacmo augment DUO_A.bvh DUO_B.bvh --preset duo_mocap --a-scale uniform=0.8 --profile b=child
    --out other

    pacmo augment data/clips/motions.parquet --clip NAME --profile b=tall_adult --out x.parquet

    pacmo augment DUO_A.bvh DUO_B.bvh --profile b=child,tall_adult,long_arms --out bodies

    A segment is a bone by its anatomical name, such as left_forearm or right_thigh, whatever its
    joints are called; uniform is all of them. The message for an unknown name lists the known ones.
    Scales and a profile of the same person multiply. The command reads the same formats as
    ``pacmo react``. BVH files are written with the hierarchy, channels, unit and axes of the input;
    those of other formats in metres, y up unless --to-unit and --to-up say otherwise.
    A page beside the files, an .html, plays the source and the variation side by side.
    """
    options = ReadOptions(form, preset, from_unit, from_up, from_fps)
    files = (first,) if second is None else (first, second)
    with solver_errors_in_one_line(" and ".join(map(str, files))):
        solving = read_solver_section(params or present_params())
        factors_of_people = [parse_factors(words) for words in (a_scale, b_scale)]
        profiles = parse_bodies(profile)
        if not any(factors_of_people) and not any(profiles):
            raise CommandError("nothing to change: give --a-scale, --b-scale or --profile")
        duo = read_two_people(files, options, clip).in_space(to_unit, to_up, out)
        places = _places(out, profiles)
        for place in places:
            check_output(duo, place)
        scales = [requested_scales(duo, factors_of_people, of_pair) for of_pair in profiles]
        typer.echo(_first_line(duo, (a_scale, b_scale), profile))
        bodies = np.stack([np.concatenate(pair) for pair in scales])
        with saying_that_it_runs(typer.echo):
            solution = retarget(prepare(duo.scene, solving.solver), bodies)
        for number, (place, of_pair) in enumerate(zip(places, profiles, strict=True)):
            label = _label((a_scale, b_scale), of_pair)
            moved = duo.moved(_split_people(duo, solution.points[number]))
            if not is_parquet(place):
                joints = " and ".join(str(len(p.skeleton.joints)) for p in duo.people)
                typer.echo(f"fitting rotations of {joints} joints to the solution ...")
            written = write_two_people(moved, scales[number], label, place)
            solved = report_measurements(solution.reports[number])
            measured = measure_written(
                duo, [written.people], [scales[number]], solving.solver, solved,
                [written.bodies] if written.bodies else [],
            )  # fmt: skip
            page = write_variation_page(duo, [written.people], measured, solving.limits, place)
            named = f" as {duo.name}~{label}" if is_parquet(place) else ""
            fidelity = written.fidelity  # its touches are among the measurements
            lines = [
                _heading(number, profiles),
                duo.rig_line(place),
                fidelity.error_line() if fidelity.is_of_files else "",
                *measured.lines(solving.limits, ADVICE),
                f"{len(duo.people[0].times)} frames in {', '.join(map(str, written.files))}{named}"
                f"; beside the source in {page}",
            ]
            typer.echo("\n".join(filter(None, lines)))


@contextmanager
def saying_that_it_runs(say: Callable[[str], object], every: float = 30.0) -> Iterator[None]:
    """Say every so many seconds for how long something has run: close bodies take minutes."""
    started, ended = time.monotonic(), threading.Event()

    def run() -> None:
        while not ended.wait(every):
            say(f"still solving, {time.monotonic() - started:.0f} s ...")

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def _label(scales: tuple[list[str], list[str]], profiles: dict[str, str]) -> str:
    """Name a variation by what was asked for: ``b-left_forearm-1.2_b-child``."""
    words = [f"{p}-{word}" for p, of_p in zip(PEOPLE, scales, strict=True) for word in of_p]
    return "_".join([*words, *map("-".join, profiles.items())]).replace("=", "-")


def _heading(number: int, profiles: list[dict[str, str]]) -> str:
    """Name the bodies that the next lines are of; nothing of one pair."""
    if len(profiles) == 1:
        return ""
    names = " and ".join(f"person {person} as {name}" for person, name in profiles[number].items())
    return f"bodies {number + 1} of {len(profiles)}, {names}:"


def _places(out: Path, profiles: list[dict[str, str]]) -> list[Path]:
    """Return the output of each pair of bodies: a folder for each, by its profiles, of several."""
    if len(profiles) == 1:
        return [out]
    if out.suffix and not out.is_dir():
        raise CommandError(f"{out}: wanted a folder for {len(profiles)} pairs of bodies")
    return [out / "_".join(of_pair.values()) for of_pair in profiles]


def parse_factors(words: list[str]) -> dict[str, float]:
    """Read ``left_forearm=1.2`` and the like."""
    factors: dict[str, float] = {}
    for word in words:
        name, _, value = word.partition("=")
        if name in factors:
            raise CommandError(f"{name}: wanted one scale; got {factors[name]:g} and {value}")
        try:
            factors[name] = float(value)
        except ValueError as fault:
            raise CommandError(f"wanted SEGMENT=SCALE, such as uniform=0.8; got {word}") from fault
        if not SCALES[0] <= factors[name] <= SCALES[1]:
            raise CommandError(f"{name}: wanted a scale of {SCALES[0]} to {SCALES[1]}; got {value}")
    return factors


def parse_profiles(words: list[str]) -> dict[str, str]:
    """Read ``b=child`` and the like."""
    pairs = [word.partition("=")[::2] for word in words]
    for (person, name), word in zip(pairs, words, strict=True):
        if person not in PEOPLE or not name:
            raise CommandError(f"wanted PERSON=NAME, such as b=child; got {word}")
        if name not in PROFILES:
            raise CommandError(f"no profile {name!r}; there are {nearest_first(name, PROFILES)}")
    if len(dict(pairs)) < len(pairs):
        raise CommandError(f"wanted one --profile a person; got {' and '.join(words)}")
    return dict(pairs)


def parse_bodies(words: list[str]) -> list[dict[str, str]]:
    """Read ``b=child,tall_adult``: the profiles of each pair of bodies; one pair without words."""
    several = [
        [f"{person}={name}" for name in names.split(",")] if equals else [person]
        for person, equals, names in (word.partition("=") for word in words)
    ]
    for names in several:
        if len(set(names)) < len(names):
            raise CommandError(f"--profile: wanted each body once; got {', '.join(names)}")
    return [parse_profiles(list(one_each)) for one_each in product(*several)]


def requested_scales(
    duo: TwoPersonCapture, factors_of_people: list[dict[str, float]], profiles: dict[str, str]
) -> tuple[Scales, Scales]:
    """Return the bone scales of person a and of person b."""
    result = []
    for person, name, factors in zip(duo.people, PEOPLE, factors_of_people, strict=True):
        body = measure_body(person.motion, person.skeleton)
        scales = known_segment_scales(body, factors)
        result.append(scales * profile_scales(body, profiles[name]) if name in profiles else scales)
    return result[0], result[1]


def known_segment_scales(body: BodyBones, factors: Mapping[str, float]) -> Scales:
    """Return the bone scales ``(E,)`` for factors of segments.

    Raises
    ------
    ValueError
        If there is no such segment: with the nearest first.
    """
    names = sorted({UNIFORM, *(segment.name for segment in body.segments)})
    for name in factors:
        if name not in names:
            raise ValueError(f"no segment {name}; there are {nearest_first(name, names)}")
    return segment_scales(body, factors)


def _first_line(
    duo: TwoPersonCapture, scales: tuple[list[str], list[str]], profile: list[str]
) -> str:
    """Say what is about to be done: it takes a while."""
    profiles = {person: names for person, _, names in (word.partition("=") for word in profile)}
    changes = [
        f"person {person} to {', '.join([*words, *filter(None, [profiles.get(person)])])}"
        for person, words in zip(PEOPLE, scales, strict=True)
        if words or person in profiles
    ]
    n_frames = len(duo.people[0].times)
    return f"solving {n_frames} frames of two people, {' and '.join(changes)} ..."


def _split_people(duo: TwoPersonCapture, points: Scales) -> tuple[Motion, Motion]:
    n_a = len(duo.people[0].skeleton.joints)
    a, b = points[:, :n_a], points[:, n_a:]
    return a.astype(np.float32), b.astype(np.float32)


@contextmanager
def solver_errors_in_one_line(files: str) -> Iterator[None]:
    """Report errors of reading, solving and writing in one line that names the files."""
    with errors_in_one_line():
        try:
            yield
        except (StoreError, FormatError) as fault:
            raise CommandError(str(fault)) from fault
        except (ValueError, KeyError, ArithmeticError, MemoryError) as fault:
            raise CommandError(f"{files}: {one_line(fault)}") from fault
