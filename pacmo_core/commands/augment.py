"""The solver's settings and what a variation must keep within, out of ``params.yaml``."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError
from ruamel.yaml import YAML

from pacmo_core.augmentation.bodies import measure_body, profile_scales, segment_scales
from pacmo_core.augmentation.filter import VariationLimits, rejection_reason
from pacmo_core.augmentation.plan import check_scale
from pacmo_core.augmentation.run import report_measurements, trunk_deformation
from pacmo_core.commands.captures import (
    PEOPLE,
    TwoPersonCapture,
    check_output,
    read_two_people,
    write_two_people,
)
from pacmo_core.data.interaction import Motion
from pacmo_core.figures.clips import measurement_summary
from pacmo_core.formats.base import FormatError
from pacmo_core.interaction_mesh import Settings, prepare, retarget
from pacmo_core.project.workspace import CommandError, errors_in_one_line
from pacmo_core.store.files import StoreError


@dataclass(frozen=True)
class SolverSection:
    """What the section ``augment`` says of solving."""

    solver: Settings
    limits: VariationLimits


def read_solver_section(params: Path) -> SolverSection:
    """Read the section ``augment``.

    Raises
    ------
    CommandError
        If there is no such file or section, or it does not fit.
    """
    if not params.is_file():
        raise CommandError(f"no {params}: give --params, such as a params.yaml")
    section = (YAML(typ="safe").load(params) or {}).get("augment")
    if not isinstance(section, dict):
        raise CommandError(f"{params}: no section augment")
    try:
        return TypeAdapter(SolverSection).validate_python(section)
    except ValidationError as fault:
        first = fault.errors()[0]
        key = ".".join(map(str, ("augment", *first["loc"])))
        raise CommandError(f"{params}, {key}: {first['msg']}, got {first['input']!r}") from fault


First = Annotated[Path, typer.Argument(help="a capture of two people, or of person a")]
Second = Annotated[Path | None, typer.Argument(help="of person b, where each has a file")]
Out = Annotated[Path, typer.Option(help="a folder or FILE.bvh for BVH files, or FILE.parquet")]
AScale = Annotated[list[str], typer.Option("--a-scale", help="SEGMENT=SCALE of person a")]
BScale = Annotated[list[str], typer.Option("--b-scale", help="SEGMENT=SCALE of person b")]
Profile = Annotated[list[str], typer.Option("--profile", help="PERSON=NAME: b=child, a=long_arms")]
Clip = Annotated[str, typer.Option(help="of a .parquet or .mat file")]
FormatName = Annotated[str | None, typer.Option("--format", help="if the ending does not tell")]
Preset = Annotated[str | None, typer.Option(help="of BVH files: duo_mocap, cmu_18_19, ...")]
Unit = Annotated[float | None, typer.Option(help="metres a unit of a BVH file")]
Up = Annotated[str | None, typer.Option(help="the capture's upward axis, y or z")]
Fps = Annotated[float | None, typer.Option(help="where the capture states none, or a wrong one")]
Params = Annotated[Path, typer.Option(help="where the solver's settings stand")]

Scales = NDArray[np.float64]


def augment(  # noqa: PLR0913  # typer reads the options off the signature
    first: First,
    second: Second = None,
    *,
    out: Out,
    a_scale: AScale = [],  # noqa: B006  # typer copies it
    b_scale: BScale = [],  # noqa: B006
    profile: Profile = [],  # noqa: B006
    clip: Clip = "",
    form: FormatName = None,
    preset: Preset = None,
    unit: Unit = None,
    up: Up = None,
    fps: Fps = None,
    params: Params = Path("params.yaml"),
) -> None:
    """Give two people other bodies, and let them interact as before.

    pacmo augment DUO_A.bvh DUO_B.bvh --unit 0.01 --up y --b-scale left_forearm=1.2 --out other

    pacmo augment DUO_A.bvh DUO_B.bvh --preset duo_mocap --a-scale uniform=0.8 --profile b=child
    --out other

    pacmo augment data/clips/motions.parquet --clip NAME --profile b=tall_adult --out x.parquet

    A segment is a bone by what it is, left_forearm or right_thigh, whatever its joints are called;
    uniform is all of them. A wrong name is answered with those that there are. Scales and a profile
    of the same person multiply. Any capture that ``pacmo react`` reads can be varied. BVH files
    come out with the tree, channels, unit and axes that they came in with.
    """
    options = {"preset": preset, "unit": unit, "up": up, "fps": fps}
    settings = {name: value for name, value in options.items() if value is not None}
    files = (first,) if second is None else (first, second)
    with solver_errors_in_one_line(" and ".join(map(str, files))):
        solving = read_solver_section(params)
        duo = read_two_people(files, form, settings, clip)
        check_output(duo, out)
        wishes = [parse_factors(words) for words in (a_scale, b_scale)]
        scales = _requested_scales(duo, wishes, _profiles(profile))
        label = "_".join([*(f"{p}-{w}" for p, ws in zip(PEOPLE, (a_scale, b_scale), strict=True)
                            for w in ws), *profile]).replace("=", "-")  # fmt: skip
        result = retarget(prepare(duo.scene, solving.solver), np.concatenate(scales)[None])
        moved = duo.moved(_split_people(duo, result.points[0]))
        places, max_error = write_two_people(moved, scales, label, out)
        figures = report_measurements(result.reports[0]) | _measure(duo, moved, scales)
        for line in _report_lines(figures, solving.limits, max_error):
            typer.echo(line)
        typer.echo(f"{len(result.points[0])} frames in {', '.join(map(str, places))}")


def parse_factors(words: list[str]) -> dict[str, float]:
    """Read ``left_forearm=1.2`` and the like."""
    factors: dict[str, float] = {}
    for word in words:
        name, _, value = word.partition("=")
        try:
            factors[name] = float(value)
        except ValueError as fault:
            raise CommandError(f"wanted SEGMENT=SCALE, such as uniform=0.8; got {word}") from fault
        check_scale(f"{name}: scales", factors[name])
    return factors


def _profiles(words: list[str]) -> dict[str, str]:
    """Read ``b=child`` and the like."""
    pairs = [word.partition("=")[::2] for word in words]
    for (person, name), word in zip(pairs, words, strict=True):
        if person not in PEOPLE or not name:
            raise CommandError(f"wanted PERSON=NAME, such as b=child; got {word}")
    return dict(pairs)


def _requested_scales(
    duo: TwoPersonCapture, wishes: list[dict[str, float]], profiles: dict[str, str]
) -> tuple[Scales, Scales]:
    """Give either person's scales."""
    if not any(wishes) and not profiles:
        raise CommandError("nothing to change: give --a-scale, --b-scale or --profile")
    result = []
    for person, name, factors in zip(duo.people, PEOPLE, wishes, strict=True):
        body = measure_body(person.motion, person.skeleton)
        scales = segment_scales(body, factors)
        result.append(scales * profile_scales(body, profiles[name]) if name in profiles else scales)
    return result[0], result[1]


def _split_people(duo: TwoPersonCapture, points: Scales) -> tuple[Motion, Motion]:
    n_a = len(duo.people[0].skeleton.joints)
    a, b = points[:, :n_a], points[:, n_a:]
    return a.astype(np.float32), b.astype(np.float32)


def _measure(
    duo: TwoPersonCapture, moved: TwoPersonCapture, scales: tuple[Scales, Scales]
) -> dict[str, float]:
    """Measure the worse of the two trunks."""
    changes = [
        trunk_deformation(source.motion, varied.motion, source.skeleton, scales_of_person)
        for source, varied, scales_of_person in zip(duo.people, moved.people, scales, strict=True)
    ]
    return {"trunk_deformation": max(changes)}


def _report_lines(figures: dict[str, float], limits: VariationLimits, miss: float) -> Iterator[str]:
    """Say how good the variation is."""
    yield measurement_summary(figures)
    if miss:
        yield f"a BVH's stiff joints keep it from that by {1e3 * miss:.1f} mm at worst"
    reason = rejection_reason(figures, limits)
    if reason:
        yield f"not good enough to train on: {reason}"


@contextmanager
def solver_errors_in_one_line(files: str) -> Iterator[None]:
    """Turn what may be wrong with two people's files into a line."""
    with errors_in_one_line():
        try:
            yield
        except (StoreError, FormatError) as fault:
            raise CommandError(str(fault)) from fault
        except (ValueError, KeyError) as fault:
            raise CommandError(f"{files}: {fault.args[0]}") from fault
