"""``pacmo augment``: two people's motion on other bodies, their interaction kept."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray

from apps.duos import PEOPLE, Duo, check_out, read_duo, write_duo
from apps.solver_settings import read_solving
from pacmo_core.augmentation.bodies import measure_body, profile_scales, segment_scales
from pacmo_core.augmentation.filter import VariationLimits, rejection_reason
from pacmo_core.augmentation.plan import check_scale
from pacmo_core.augmentation.run import report_measurements, trunk_deformation
from pacmo_core.data.interaction import Motion
from pacmo_core.figures.variations import said
from pacmo_core.formats.base import FormatError
from pacmo_core.interaction_mesh import prepare, retarget
from pacmo_core.project.workspace import CommandError, errors_in_one_line
from pacmo_core.store.files import StoreError

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
    with told(" and ".join(map(str, files))):
        solving = read_solving(params)
        duo = read_duo(files, form, settings, clip)
        check_out(duo, out)
        wishes = [factors_of(words) for words in (a_scale, b_scale)]
        scales = _bodies(duo, wishes, _profiles(profile))
        label = "_".join([*(f"{p}-{w}" for p, ws in zip(PEOPLE, (a_scale, b_scale), strict=True)
                            for w in ws), *profile]).replace("=", "-")  # fmt: skip
        found = retarget(prepare(duo.scene, solving.solver), np.concatenate(scales)[None])
        moved = duo.moved(_parted(duo, found.points[0]))
        places, miss = write_duo(moved, scales, label, out)
        figures = report_measurements(found.reports[0]) | _shape(duo, moved, scales)
        for line in _lines(figures, solving.limits, miss):
            typer.echo(line)
        typer.echo(f"{len(found.points[0])} frames in {', '.join(map(str, places))}")


def factors_of(words: list[str]) -> dict[str, float]:
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


def _bodies(
    duo: Duo, wishes: list[dict[str, float]], profiles: dict[str, str]
) -> tuple[Scales, Scales]:
    """Give either person's scales."""
    if not any(wishes) and not profiles:
        raise CommandError("nothing to change: give --a-scale, --b-scale or --profile")
    found = []
    for person, name, factors in zip(duo.people, PEOPLE, wishes, strict=True):
        body = measure_body(person.motion, person.skeleton)
        scales = segment_scales(body, factors)
        found.append(scales * profile_scales(body, profiles[name]) if name in profiles else scales)
    return found[0], found[1]


def _parted(duo: Duo, points: Scales) -> tuple[Motion, Motion]:
    n_a = len(duo.people[0].skeleton.joints)
    a, b = points[:, :n_a], points[:, n_a:]
    return a.astype(np.float32), b.astype(np.float32)


def _shape(duo: Duo, moved: Duo, scales: tuple[Scales, Scales]) -> dict[str, float]:
    """Measure the worse of the two trunks."""
    changes = [
        trunk_deformation(source.motion, varied.motion, source.skeleton, own)
        for source, varied, own in zip(duo.people, moved.people, scales, strict=True)
    ]
    return {"trunk_deformation": max(changes)}


def _lines(figures: dict[str, float], limits: VariationLimits, miss: float) -> Iterator[str]:
    """Say how good the variation is."""
    yield said(figures)
    if miss:
        yield f"a BVH's stiff joints keep it from that by {1e3 * miss:.1f} mm at worst"
    reason = rejection_reason(figures, limits)
    if reason:
        yield f"not good enough to train on: {reason}"


@contextmanager
def told(files: str) -> Iterator[None]:
    """Turn what may be wrong with two people's files into a line."""
    with errors_in_one_line():
        try:
            yield
        except (StoreError, FormatError) as fault:
            raise CommandError(str(fault)) from fault
        except (ValueError, KeyError) as fault:
            raise CommandError(f"{files}: {fault.args[0]}") from fault
