"""``pacmo vary``: retarget two people's motion to other bodies by a trained skeleton prior."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import torch
import typer
from numpy.typing import NDArray

from pacmo_core.commands.augment import (
    AScale,
    BScale,
    Clip,
    First,
    Out,
    Profile,
    Second,
    parse_factors,
    parse_profiles,
    present_params,
    read_solver_section,
    requested_scales,
    solver_errors_in_one_line,
)
from pacmo_core.commands.bvh_fidelity import Fidelity
from pacmo_core.commands.captures import (
    ToOtherUnit,
    ToOtherUp,
    TwoPersonCapture,
    check_output,
    is_parquet,
    read_two_people,
    two_sources,
    write_two_people,
)
from pacmo_core.commands.measured import measure_written, write_variation_page
from pacmo_core.commands.react import check_request, check_total
from pacmo_core.commands.reading import (
    FormatName,
    FromFps,
    FromUnit,
    FromUp,
    Joints,
    Preset,
    ReadOptions,
    to_model_joints,
)
from pacmo_core.commands.weights import is_synthetic, trained_on_line
from pacmo_core.data.interaction import Interaction
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.formats.registry import PersonMotion
from pacmo_core.models import load_skeleton_prior
from pacmo_core.project.workspace import CommandError, in_project
from pacmo_core.skeleton_prior.inference import generate_skeletons, retarget
from pacmo_core.skeleton_prior.vae import SkeletonPrior
from pacmo_core.store.motions import write_motions

WEIGHTS = in_project(Path("models/priors/default/random/kinematic/1/weights.safetensors"))

Weights = Annotated[Path, typer.Option(help="a trained skeleton prior")]
Samples = Annotated[int, typer.Option(min=1, help="number of interactions to sample")]
Seed = Annotated[int, typer.Option(min=0, help="the same seed gives the same interactions")]

Scales = NDArray[np.float64]
People = tuple[PersonMotion, PersonMotion]


def vary(  # noqa: PLR0913  # typer reads the options off the signature
    first: First,
    second: Second = None,
    *,
    out: Out,
    a_scale: AScale = [],  # noqa: B006  # typer copies it
    b_scale: BScale = [],  # noqa: B006
    profile: Profile = [],  # noqa: B006
    samples: Samples = 1,
    seed: Seed = 0,
    weights: Weights = WEIGHTS,
    clip: Clip = "",
    form: FormatName = None,
    preset: Preset = None,
    from_unit: FromUnit = [],  # noqa: B006
    from_up: FromUp = [],  # noqa: B006
    from_fps: FromFps = [],  # noqa: B006
    joints: Joints = [],  # noqa: B006
    to_unit: ToOtherUnit = None,
    to_up: ToOtherUp = None,
) -> None:
    """Retarget two people's motion to other bodies by a trained skeleton prior.

    pacmo vary DUO_A.bvh DUO_B.bvh --preset duo_mocap --samples 20 --weights W --out other

    pacmo vary DUO_A.bvh DUO_B.bvh --b-scale left_forearm=1.2 --weights W --out other

    pacmo vary DUO_A.bvh DUO_B.bvh --profile b=child --samples 4 --weights W --out other

    Without scales and profiles the bodies are sampled too, a new one of person b for each sample.
    Several samples are written to folders 0, 1, ... of BVH files, or to one Parquet file. A capture
    of another skeleton than the model's is taken if the model's joints can be named in it
    (--joints); BVH files then have the joints of the model, in metres, y up unless --to-unit and
    --to-up say otherwise; else they are on the rig of the capture. ``pacmo augment`` solves the
    same problem by optimisation, which takes longer.
    """
    options = ReadOptions(form, preset, from_unit, from_up, from_fps, joints)
    files = (first,) if second is None else (first, second)
    torch.set_num_threads(1)
    with solver_errors_in_one_line(" and ".join(map(str, files))):
        factors_of_people = [parse_factors(words) for words in (a_scale, b_scale)]
        profiles = parse_profiles(profile)
        check_request(samples, options, weights)
        model = load_skeleton_prior(weights)
        synthetic = is_synthetic(first, clip)
        typer.echo(trained_on_line(weights, synthetic_capture=synthetic))
        duo = _select_joints(read_two_people(files, options, clip), model.config.skeleton, options)
        check_total(2 * samples, len(duo.people[0].times), len(model.config.skeleton.joints))
        duo = duo.in_space(to_unit, to_up, out)
        places = _output_files(duo, samples, out)
        random = torch.Generator().manual_seed(seed)
        variations = list(_variations(model, duo, factors_of_people, profiles, samples, random))
        written, fidelity, people = _write(duo, variations, places)
        if line := duo.rig_line(places[0]):
            typer.echo(line)
        if fidelity.is_inexact:
            typer.echo(fidelity.line())
        solving = read_solver_section(present_params())
        bodies = [(a, b) for _, (a, b) in variations]
        measured = measure_written(duo, people, bodies, solving.solver)
        for line in measured.lines(solving.limits):
            typer.echo(line)
        page = write_variation_page(duo, people, measured, solving.limits, out)
        named = f" as {_some(_names(duo, samples))}" if is_parquet(out) else ""
        typer.echo(
            f"{len(variations)} x {len(duo.people[0].times)} frames in "
            f"{_some(written)}{named}; beside the source in {page}"
        )


def _select_joints(
    duo: TwoPersonCapture, skeleton: Skeleton, options: ReadOptions
) -> TwoPersonCapture:
    """Select the joints of the model of both people, each by the names of their own capture."""
    sources = two_sources(duo.files)
    a, b = (
        to_model_joints(person, skeleton, source, options)
        for person, source in zip(duo.people, sources, strict=True)
    )
    has_same_names = all(set(skeleton.joints) <= set(p.skeleton.joints) for p in duo.people)
    keeps = duo.keeps_hierarchy and has_same_names and not options.joints
    return replace(duo, people=(a, b), keeps_hierarchy=keeps, joints_of="model")


def _variations(
    model: SkeletonPrior,
    duo: TwoPersonCapture,
    factors_of_people: list[dict[str, float]],
    profiles: dict[str, str],
    samples: int,
    random: torch.Generator,
) -> Iterator[tuple[Interaction, Scales]]:
    """Yield interactions and the scales (2, E) of their bodies: given, or sampled."""
    a, b = duo.people
    source = Interaction(model.config.skeleton, a.times - a.times[0], a.motion, b.motion)
    if any(factors_of_people) or profiles:
        scales = np.stack(requested_scales(duo, factors_of_people, profiles))[None]
        (result,) = retarget(model, source, scales, samples=samples, random=random, finish=True)
        yield from ((pair, scales[0]) for pair in result)
        return
    scales = generate_skeletons(model, samples, random=random)
    variations = retarget(model, source, scales, samples=1, random=random, finish=True)
    yield from (
        (pair, scales_of_person)
        for (pair,), scales_of_person in zip(variations, scales, strict=True)
    )


def _output_files(duo: TwoPersonCapture, samples: int, out: Path) -> list[Path]:
    """Return the output of each sample: one file or folder, or a folder for each."""
    if samples == 1 or is_parquet(out):
        files = [out]
    elif out.suffix and not out.is_dir():
        raise CommandError(f"{out}: wanted a folder or a .parquet file for {samples} samples")
    else:
        files = [out / str(number) for number in range(samples)]
    for file in files:
        check_output(duo, file)
    return files


def _names(duo: TwoPersonCapture, samples: int) -> list[str]:
    """Name the samples in a Parquet file."""
    return [f"{duo.name}~{number:04d}" for number in range(samples)]


def _some(things: Sequence[object]) -> str:
    return f"{', '.join(map(str, things[:4]))}{' ...' if things[4:] else ''}"


def _write(
    duo: TwoPersonCapture, variations: list[tuple[Interaction, Scales]], places: list[Path]
) -> tuple[list[Path], Fidelity, list[People]]:
    """Write all samples, to one Parquet file or each to its own output.

    Returns
    -------
    The files, how well they hold the motions, and the people in them, of each sample.
    """
    moved = [duo.moved((pair.person_a, pair.person_b)) for pair, _ in variations]
    if is_parquet(places[0]):
        with write_motions(places[0], duo.people[0].skeleton) as writer:
            names = _names(duo, len(variations))
            for name, (pair, _) in zip(names, variations, strict=True):
                writer.add(name, pair)
        return places, Fidelity(), [one.people for one in moved]
    files, people, fidelity = list[Path](), list[People](), Fidelity()
    for number, (one, (_, scales), out) in enumerate(zip(moved, variations, places, strict=True)):
        written = write_two_people(one, (scales[0], scales[1]), str(number), out)
        files += written.files
        fidelity += written.fidelity
        people.append(written.people)
    return files, fidelity, people
