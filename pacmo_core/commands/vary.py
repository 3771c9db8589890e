"""``pacmo vary``: retarget two people's motion to other bodies by a trained skeleton prior.

A skeleton prior adds a network to a start, a rule that needs no training. Where the evaluation of
the same weights does not show that the network is better, the start alone makes the motions.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import torch
import typer
from numpy.typing import NDArray
from pydantic import TypeAdapter

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
    PEOPLE,
    FormatName,
    FromFps,
    FromUnit,
    FromUp,
    Joints,
    Preset,
    ReadOptions,
    to_model_joints,
)
from pacmo_core.commands.sample_table import listed
from pacmo_core.commands.weights import (
    PACKAGED_PRIOR,
    PRIOR_TRAINED_HERE,
    default_prior,
    is_synthetic,
    trained_on_line,
)
from pacmo_core.data.interaction import Interaction, Motion
from pacmo_core.data.names import MAX_NEAREST
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.formats.registry import PersonMotion
from pacmo_core.interaction_mesh.scene import MIN_LENGTH
from pacmo_core.models import load_skeleton_prior
from pacmo_core.project.workspace import CommandError
from pacmo_core.skeleton_prior.inference import MAX_TEMPERATURE, generate_skeletons, retarget
from pacmo_core.skeleton_prior.training import build_start
from pacmo_core.skeleton_prior.vae import SkeletonPrior
from pacmo_core.store.files import file_hash
from pacmo_core.store.motions import write_motions

# Of the project that weights lie in: what their training adds to the start (pool_skeleton_prior).
EVALUATION = Path("reports/skeleton_prior.json")
# Share of the start's errors that training must remove, on average and with an interval above 0.
MIN_GAIN = 0.2
ERRORS = {
    "E_r": "error of joints E_r",
    "JPD": "error of distances between the two people JPD",
    "JPD_sampled": "JPD on sampled bodies",
}
# Which errors decide, of bodies that are asked for and of sampled ones.
OF_GIVEN, OF_SAMPLED = ("E_r", "JPD"), ("JPD_sampled",)
START_ALONE = "the start alone, a rule without training,"

Weights = Annotated[
    Path | None,
    typer.Option(
        help=f"a trained skeleton prior; default: {PRIOR_TRAINED_HERE} if it exists, else the "
        "package's"
    ),
]
Samples = Annotated[int, typer.Option(min=1, help="number of interactions to sample")]
Network = Annotated[
    bool | None,
    typer.Option(
        "--network/--no-network",
        help="use the network, or its start alone; by default what the evaluation shows is better",
    ),
]
Temperature = Annotated[
    float,
    typer.Option(
        min=0,
        max=MAX_TEMPERATURE,
        help="of the samples of a network: below 1 more alike, 0 the most usual one",
    ),
]
Seed = Annotated[int, typer.Option(min=0, help="the same seed gives the same interactions")]

ADVICE = (
    "pacmo augment, the solver, keeps near distances and contacts: give it the same files, and the "
    "bodies with --a-scale, --b-scale or --profile"
)
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
    temperature: Temperature = 1.0,
    seed: Seed = 0,
    weights: Weights = None,
    network: Network = None,
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

    pacmo vary DUO_A.bvh DUO_B.bvh --preset duo_mocap --samples 20 --out other

    pacmo vary DUO_A.bvh DUO_B.bvh --b-scale left_forearm=1.2 --out other

    pacmo vary DUO_A.bvh DUO_B.bvh --profile b=child --samples 4 --weights W --out other

    Without --weights the skeleton prior is that of a run here, else the one in the package.

    The network is used if reports/skeleton_prior.json of the project that the weights lie in shows
    that these weights are better than their start, a rule without training, on such bodies (asked
    for, or sampled), or if nothing there is about them; else the start alone. --network and
    --no-network choose.

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
        profiles = _one_profile_each(profile)
        chosen = check_request(samples, options, weights or default_prior())
        model = load_skeleton_prior(chosen)
        duo = _select_joints(read_two_people(files, options, clip), model.config.skeleton, options)
        check_total(2 * samples, len(duo.people[0].times), len(model.config.skeleton.joints))
        typer.echo(trained_on_line(chosen, synthetic_capture=is_synthetic(first, clip)))
        errors = OF_GIVEN if any(factors_of_people) or profiles else OF_SAMPLED
        uses_network, reason = choose_network(chosen, network, errors)
        typer.echo(reason)
        duo = duo.in_space(to_unit, to_up, out)
        places = _output_files(duo, samples, out)
        random = torch.Generator().manual_seed(seed)
        bodies = _bodies(model, duo, factors_of_people, profiles, samples, random)
        for line in _body_lines(bodies, duo, samples, temperature, uses_network=uses_network):
            typer.echo(line)
        mover = model if uses_network else build_start(model.config)
        variations = list(_variations(mover, duo, bodies, samples, random, temperature))
        written, fidelity, people, in_files = _write(duo, variations, places)
        if line := duo.rig_line(places[0]):
            typer.echo(line)
        if fidelity.is_of_files:
            typer.echo(fidelity.line())
        page = _say_measured(duo, variations, people, in_files, out)
        named = f" as {_some(_names(duo, samples))}" if is_parquet(out) else ""
        typer.echo(
            f"{len(variations)} x {len(duo.people[0].times)} frames in "
            f"{_some(written)}{named}; beside the source in {page}"
        )


@dataclass(frozen=True)
class ErrorGain:
    """By how much training lowers an error of the start, on test motions.

    Parameters
    ----------
    start, trained : metres, mean over motions
    mean : share of the start's error, mean over motions
    low, high : its interval over motions; None of one motion, which has no interval
    """

    start: float
    trained: float
    mean: float
    low: float | None = None
    high: float | None = None

    @property
    def is_shown(self) -> bool:
        """Whether the gain is as large as is wanted, and its interval above zero."""
        return self.mean >= MIN_GAIN and self.low is not None and self.low > 0

    def __str__(self) -> str:
        """Say the change: ``16.8 to 13.0 mm, -19 % (-41 to 4)``."""
        change = f"{1e3 * self.start:.1f} to {1e3 * self.trained:.1f} mm, {_percent(-self.mean)} %"
        if self.low is None or self.high is None:
            return f"{change} (no interval)"
        return f"{change} ({_percent(-self.high)} to {_percent(-self.low)})"


def _percent(share: float) -> str:
    return f"{round(100 * share)}"  # an integer, of which there is no −0


@dataclass(frozen=True)
class Evidence:
    """What the training of weights adds to their start.

    Parameters
    ----------
    split : the dataset and split of variations, with a slash between them
    motions : how many were tested
    confidence : of the intervals
    gains : by the name of the error
    """

    split: str
    motions: int
    confidence: float
    gains: Mapping[str, ErrorGain]

    @property
    def is_better(self) -> bool:
        """Whether the network is shown to be better than its start by every error, and by any."""
        return bool(self.gains) and all(gain.is_shown for gain in self.gains.values())

    def __str__(self) -> str:
        """Say it in words."""
        motions = f"{self.motions} motion{'s' if self.motions > 1 else ''}"
        gains = "; ".join(f"{ERRORS[name]} {gain}" for name, gain in self.gains.items())
        if not gains:
            return f"tested on {self.split}, {motions}, not on sampled bodies"
        return (
            f"tested on {self.split}, {motions}; start to network, {100 * self.confidence:.0f} % "
            f"intervals: {gains}"
        )


def _one_profile_each(words: list[str]) -> dict[str, str]:
    if several := [word for word in words if "," in word]:
        raise CommandError(f"vary takes one profile a person in a call; got {several[0]}")
    return parse_profiles(words)


def choose_network(weights: Path, asked: bool | None, errors: Sequence[str]) -> tuple[bool, str]:
    """Choose between the network and its start alone; say which, and why.

    Parameters
    ----------
    asked : for the network, for the start, or for what is better
    errors : of ``ERRORS``, by all of which the network must be better

    Raises
    ------
    CommandError
        If the evaluation of the weights cannot be read.
    """
    evidence = find_evidence(weights, errors)
    known = evidence or f"no {EVALUATION} compares these weights with their start"
    if asked is not None:
        return asked, f"{'the network' if asked else START_ALONE} is used, as asked ({known})"
    if evidence is None:
        return True, f"the network is used ({known})"
    if evidence.is_better:
        return True, f"the network is used, shown to be better than its start ({known})"
    reason = f"the network is not shown to be better ({known}); --network uses it"
    return False, f"{START_ALONE} is used: {reason}"


def find_evidence(weights: Path, wanted: Sequence[str]) -> Evidence | None:
    """Find what was measured of weights, by their content: in their project, or in their card.

    Parameters
    ----------
    wanted : the errors, of ``ERRORS``; those that were not measured are left out

    Raises
    ------
    CommandError
        If there is an evaluation that cannot be read.
    """
    files = [folder / EVALUATION for folder in weights.absolute().parents]
    if weights == PACKAGED_PRIOR:
        files = [PACKAGED_PRIOR.with_suffix(".json")]
    file = next(filter(Path.is_file, files), None)
    if file is None:
        return None
    content = file_hash(weights)
    try:
        for dataset, splits in json.loads(file.read_text("utf-8"))["gain"].items():
            for split, gain in splits.items():
                if content in gain.get("weights", ()):
                    errors = {name: gain[name] for name in wanted if name in gain}
                    facts = {"split": f"{dataset}/{split}", "gains": errors}
                    return TypeAdapter(Evidence).validate_python({**gain, **facts})
    except (ValueError, KeyError, TypeError, AttributeError) as fault:
        reason = " ".join(str(fault).split())[:200]
        raise CommandError(f"{file}: not an evaluation of skeleton priors: {reason}") from fault
    return None


def _select_joints(
    duo: TwoPersonCapture, skeleton: Skeleton, options: ReadOptions
) -> TwoPersonCapture:
    """Select the joints of the model of both people, each by the names of their own capture."""
    sources = two_sources(duo.files)
    a, b = to_model_joints(duo.as_read, skeleton, sources, options)
    for source, person, captured in zip(sources, (a, b), duo.as_read, strict=True):
        _check_bones(source.file, person, captured)
    has_same_names = all(set(skeleton.joints) <= set(p.skeleton.joints) for p in duo.as_read)
    keeps = duo.keeps_hierarchy and has_same_names and not options.joints
    return replace(duo, people=(a, b), keeps_hierarchy=keeps, joints_of="model", bodies=duo.whole)


def _check_bones(file: Path, person: PersonMotion, captured: PersonMotion) -> None:
    """Refuse a bone without length, such as to a neck that a capture has between the shoulders."""
    parent, child = person.skeleton.bones.T
    lengths = np.linalg.norm(person.motion[:, child] - person.motion[:, parent], axis=-1)
    if lengths.min() < MIN_LENGTH:
        frame, bone = np.argwhere(lengths < MIN_LENGTH)[0]
        above, below = (person.skeleton.joints[end[bone]] for end in (parent, child))
        near = _free_joints(person, int(child[bone]), captured)
        example = f"such as --joints {above}={near[0]}" if near else f"by --joints {below}=JOINT"
        more = f" (the nearest that no joint of the model is: {', '.join(near)})" if near else ""
        raise CommandError(
            f"{file}: {above} and {below} coincide in frame {frame}: wanted another joint of the "
            f"capture for one of them, {example}{more}"
        )


def _free_joints(person: PersonMotion, joint: int, captured: PersonMotion) -> list[str]:
    """Name the joints of a capture nearest to one of the model, where none of the model's is.

    Near a joint without a mirror image these are joints of the trunk too, not of a side.
    """
    sided = {row for pair in captured.skeleton.left_right for row in pair}
    is_sided = any(joint in pair for pair in person.skeleton.left_right)
    taken = np.moveaxis(person.motion, 1, 0)

    def distance(row: int, place: Motion) -> float:
        return float(np.linalg.norm(captured.motion[:, row] - place, axis=-1).mean())

    free = [
        row
        for row in range(len(captured.skeleton.joints))
        if (is_sided or row not in sided)
        and all(distance(row, place) >= MIN_LENGTH for place in taken)
    ]
    free.sort(key=lambda row: distance(row, taken[joint]))
    return [captured.skeleton.joints[row] for row in free[:MAX_NEAREST]]


def _bodies(
    model: SkeletonPrior,
    duo: TwoPersonCapture,
    factors_of_people: list[dict[str, float]],
    profiles: dict[str, str],
    samples: int,
    random: torch.Generator,
) -> Scales:
    """Return scales (V, 2, E) of bodies: the one that is asked for, or one for each sample."""
    if any(factors_of_people) or profiles:
        return np.stack(requested_scales(duo, factors_of_people, profiles))[None]
    return generate_skeletons(model, samples, random=random)


def _body_lines(
    bodies: Scales,
    duo: TwoPersonCapture,
    samples: int,
    temperature: float,
    *,
    uses_network: bool,
) -> Iterator[str]:
    """Say how sampled bodies (V, 2, E) scale the bones, and what the start makes no use of."""
    if temperature != 1 and not uses_network:
        yield "--temperature changes nothing: the start is a rule, without latents"
    if len(bodies) < samples and not uses_network:
        yield f"the start makes one motion of a body: the {samples} samples are equal"
    if len(bodies) < 2:
        return
    texts = []
    for row, person in enumerate(duo.people):
        ends = person.motion[:, person.skeleton.bones]
        lengths = np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=-1).mean(axis=0)
        of_person = bodies[:, row]
        means = np.average(of_person, axis=1, weights=lengths)
        scales = (
            f"{listed([f'{mean:.2f}' for mean in means])} of the captured, single bones "
            f"{of_person.min():.2f} to {of_person.max():.2f}"
        )
        is_same = np.allclose(of_person, 1)
        texts.append(f"person {PEOPLE[row]} {'as captured' if is_same else scales}")
    yield f"sampled bodies, mean length of the bones: {'; '.join(texts)}"


def _variations(
    mover: SkeletonPrior,
    duo: TwoPersonCapture,
    bodies: Scales,
    samples: int,
    random: torch.Generator,
    temperature: float,
) -> Iterator[tuple[Interaction, Scales]]:
    """Yield interactions and the scales (2, E) of their bodies, of which one has all samples."""
    a, b = duo.people
    source = Interaction(mover.config.skeleton, a.times - a.times[0], a.motion, b.motion)
    each = samples // len(bodies)
    motions = retarget(
        mover, source, bodies, samples=each, random=random, temperature=temperature, finish=True
    )
    for pairs, scales in zip(motions, bodies, strict=True):
        yield from ((pair, scales) for pair in pairs)


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


def _say_measured(
    duo: TwoPersonCapture,
    variations: list[tuple[Interaction, Scales]],
    people: list[People],
    in_files: list[People],
    out: Path,
) -> Path:
    """Print the measurements of what was written; return the page that is written of it."""
    solving = read_solver_section(present_params())
    bodies = [(a, b) for _, (a, b) in variations]
    measured = measure_written(duo, people, bodies, solving.solver, in_files=in_files)
    for line in measured.lines(solving.limits, ADVICE):
        typer.echo(line)
    return write_variation_page(duo, people, measured, solving.limits, out)


def _write(
    duo: TwoPersonCapture, variations: list[tuple[Interaction, Scales]], places: list[Path]
) -> tuple[list[Path], Fidelity, list[People], list[People]]:
    """Write all samples, to one Parquet file or each to its own output.

    Returns
    -------
    The files, how well they hold the motions, and of each sample the people in them: their joints
    of the model, and of BVH files all joints and End Sites.
    """
    moved = [duo.moved((pair.person_a, pair.person_b)) for pair, _ in variations]
    if is_parquet(places[0]):
        with write_motions(places[0], duo.people[0].skeleton) as writer:
            names = _names(duo, len(variations))
            for name, (pair, _) in zip(names, variations, strict=True):
                writer.add(name, pair)
        return places, Fidelity(), [one.people for one in moved], []
    files, fidelity = list[Path](), Fidelity()
    people, in_files = list[People](), list[People]()
    for number, (one, (_, scales), out) in enumerate(zip(moved, variations, places, strict=True)):
        written = write_two_people(
            one, (scales[0], scales[1]), str(number), out,
            f"sample {number}" if len(variations) > 1 else "",
        )  # fmt: skip
        files += written.files
        fidelity += written.fidelity
        people.append(written.people)
        if written.bodies:
            in_files.append(written.bodies)
    return files, fidelity, people, in_files
