"""``pacmo react``: reactions to a capture, or to frames on standard input."""

import json
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
import typer
from numpy.typing import NDArray

from pacmo_core.commands.captures import (
    OutputSpace,
    ToUnit,
    ToUp,
    check_outputs,
    is_parquet,
    meant_times,
)
from pacmo_core.commands.doubts import MIN_BONE_LENGTH, doubts
from pacmo_core.commands.motion_checks import is_within_limits, motion_lines
from pacmo_core.commands.react_files import (
    Reactions,
    check_reactions_output,
    files_line,
    output_files,
    write_reactions,
)
from pacmo_core.commands.reacting_people import BodyOf, read_reacting_people
from pacmo_core.commands.reading import (
    FormatName,
    FromFps,
    FromUnit,
    FromUp,
    Joints,
    Preset,
    ReadOptions,
    Source,
    capture_name,
    parse_unit,
)
from pacmo_core.commands.weights import (
    TRAINED_HERE,
    find_weights,
    is_synthetic,
    trained_on_line,
)
from pacmo_core.data.interaction import Motion
from pacmo_core.data.limits import MAX_POSITIONS, MAX_SAMPLES
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.finish.body import TargetBody
from pacmo_core.formats.inference import implausible
from pacmo_core.formats.registry import PersonMotion
from pacmo_core.formats.resample import sample_times
from pacmo_core.metrics.touching import (
    MAX_DRAWN,
    TouchName,
    check_hands,
    draw_until,
    is_as_asked,
)
from pacmo_core.models import load_reaction_model
from pacmo_core.operators.spline import Spline
from pacmo_core.project.workspace import CommandError, reading_errors_in_one_line
from pacmo_core.reaction.inference import finish_reactions, react_all
from pacmo_core.reaction.stream import ReactionStream, UnusableFrameError
from pacmo_core.reaction.windows import (
    PartnerMotion,
    ReactionModel,
    action_index,
    gives_one,
    is_deterministic,
    known_actions,
    max_duration,
    mean_duration,
    sample_poses,
    set_temperature,
)


def react_to_lines(lines: Iterable[str], live: ReactionStream, skeleton: Skeleton) -> Iterator[str]:
    """Yield the reaction to each line in the format of the line: JSON, or numbers.

    A frame that is late, repeated or not tracked has the reaction of the one before, and a warning.
    """
    reactions: Motion | None = None
    for number, line in enumerate(lines, start=1):
        if not line.strip():
            continue
        try:
            time, pose, as_json = _parse_frame(line, len(skeleton.joints))
            if reactions is None:
                _check_first_frame(pose, skeleton)
            reactions = live.react(pose, time)
        except (ValueError, KeyError, TypeError, ArithmeticError, RecursionError) as fault:
            if reactions is None or not isinstance(fault, UnusableFrameError):
                raise CommandError(f"line {number}: {fault}") from fault
            typer.echo(f"line {number}: {fault}; the reaction stays as it was", err=True)
        yield _json(time, reactions) if as_json else _numbers(time, reactions)


def _check_first_frame(pose: Motion, skeleton: Skeleton) -> None:
    """Refuse a partner who is no person in metres; say that one lies, as with another axis up.

    Raises
    ------
    ValueError
        If the stature is impossible.
    """
    if pose.shape != (len(skeleton.joints), 3) or not np.isfinite(pose).all():
        return  # which is said where it is answered
    if np.ptp(pose, axis=0).max() < MIN_BONE_LENGTH:
        raise ValueError("all joints are in one place: wanted a person, from the first frame on")
    fault = implausible([(skeleton, pose[None])], [None])
    if fault:
        raise ValueError(f"{fault[1]}: frames are in metres, y up")
    person = PersonMotion(skeleton, np.zeros(1), pose[None])
    for line in doubts([Path("the first frame")], [person]):
        typer.echo(line, err=True)


def _parse_frame(line: str, n_joints: int) -> tuple[float, Motion, bool]:
    as_json = line.lstrip().startswith("{")
    if as_json:
        frame: dict[str, Any] = json.loads(line)
        if set(frame) != {"time", "pose"}:
            raise ValueError(f"wanted the keys time and pose; got {sorted(frame)}")
        pose = np.array(frame["pose"])
        if pose.dtype.kind == "O" and all(type(x) in (float, int, type(None)) for x in pose.flat):
            pose = pose.astype(np.float64)  # null is NaN, which JSON has not
        if isinstance(frame["time"], str) or pose.dtype.kind not in "if":
            raise ValueError("wanted numbers as time and pose")
        return float(frame["time"]), pose.astype(np.float32), True
    words = line.replace(",", " ").split()
    if len(words) != 1 + 3 * n_joints:
        raise ValueError(f"wanted a time and {3 * n_joints} numbers; got {len(words)} in all")
    # float() also takes underscores and the digits of other scripts.
    wrong = [word for word in words if not word.isascii() or "_" in word]
    if wrong:
        raise ValueError(f"wanted a number; got {wrong[0][:40]!r}")
    values = np.array(words, np.float64)
    return float(values[0]), values[1:].astype(np.float32).reshape(-1, 3), False


def _json(time: float, reactions: Motion) -> str:
    return json.dumps({"time": time, "reactions": reactions.astype(np.float64).round(6).tolist()})


def _numbers(time: float, reactions: Motion) -> str:
    return " ".join([repr(time), *(f"{value:.6f}" for value in reactions.reshape(-1).tolist())])


MIN_FRAMES = 4  # of a cubic spline
MAX_LINE = 1 << 20  # characters of a frame: a longer line is read, and refused, in parts

# A list, so that a second file is refused with the reason, not as wrong usage.
PartnerFile = Annotated[
    list[Path], typer.Argument(help="one capture, of one person or of two", metavar="PARTNER")
]
Out = Annotated[Path | None, typer.Option(help="FILE.parquet, FILE.bvh, or a folder for BVH files")]
Weights = Annotated[
    Path | None,
    typer.Option(
        help=f"a trained model, or package; default: {TRAINED_HERE} if it is there, else package"
    ),
]
ToFps = Annotated[
    float | None, typer.Option(help="frame rate of the reaction; default: that of the partner")
]
Samples = Annotated[int, typer.Option(min=1, help="number of reactions to sample")]
Seed = Annotated[int, typer.Option(min=0, help="the same seed gives the same reactions")]
PersonName = Annotated[
    str | None, typer.Option(help="the partner, a or b, if the capture has two people")
]
Action = Annotated[
    str,
    typer.Option(
        help="what the two do, in words of one of the model's action labels, such as hug; without "
        "it the model judges by the partner's motion"
    ),
]
Temperature = Annotated[
    float | None,
    typer.Option(
        help="standard deviation of the noise that reactions are sampled from; default: the "
        "model's, 1 in the package; 0.6 gives more alike and usual ones, 0 one; 2 at most"
    ),
]
Clip = Annotated[str, typer.Option(help="name of the clip in a .parquet or .mat file")]
Finish = Annotated[
    bool,
    typer.Option(
        help="exact bones, planted feet, closed contacts; of --stream: exact bones, the shape of "
        "the trunk, no feet below the floor"
    ),
]
Rig = Annotated[
    Path | None,
    typer.Option(
        help="FILE.bvh of the person who reacts: the reaction gets its bone lengths, and BVH files "
        "its hierarchy, unit and axes"
    ),
]


Bones = Annotated[
    BodyOf | None,
    typer.Option(
        "--body",
        help="bone lengths of the reaction: those of the partner, or of the other person of the "
        "capture; default: the model's choice",
    ),
]
Touching = Annotated[
    TouchName | None,
    typer.Option(
        "--touch",
        help="what touches for 0.1 s or more: right or left hands, any hands, bodies in an "
        "embrace, a hand the other's body, or no hand; others are dropped, further ones sampled",
    ),
]
WithinLimits = Annotated[
    bool,
    typer.Option(
        "--within-limits",
        help="drop the reactions that are, as generated, beyond a limit of the table, and sample "
        "further ones",
    ),
]
Live = Annotated[bool, typer.Option("--stream", help="react to frames on standard input")]


def react(  # noqa: PLR0913  # typer reads the options off the signature
    partner: PartnerFile = [],  # noqa: B006  # typer copies it
    *,
    out: Out = None,
    weights: Weights = None,
    samples: Samples = 1,
    seed: Seed = 0,
    temperature: Temperature = None,
    person: PersonName = None,
    clip: Clip = "",
    action: Action = "",
    form: FormatName = None,
    preset: Preset = None,
    from_unit: FromUnit = [],  # noqa: B006  # typer copies it
    from_up: FromUp = [],  # noqa: B006
    from_fps: FromFps = [],  # noqa: B006
    joints: Joints = [],  # noqa: B006
    rig: Rig = None,
    body: Bones = None,
    touch: Touching = None,
    within_limits: WithinLimits = False,
    to_unit: ToUnit = None,
    to_up: ToUp = None,
    to_fps: ToFps = None,
    stream: Live = False,
    finish: Finish = True,
) -> None:
    """Generate reactions to a partner's motion.

    pacmo react walk.bvh --samples 8 --to-fps 120 --out reactions.parquet

    pacmo react walk.bvh --from-unit cm --from-up y --joints mixamo --to-unit cm --out reaction.bvh

    pacmo react anna.bvh --rig ben.bvh --out reaction.bvh

    pacmo react data/clips/motions.parquet --clip NAME --person a --out reaction.bvh

    Input formats: BVH, ASF/AMC, NTU .skeleton, ExPI .tsv, InterHuman .npy, DuetDance .mat and .txt
    (--format duetdance), SBU .txt (--format sbu), tables of joints (.npz, .csv, .parquet) and this
    project's Parquet with --clip. A capture of another skeleton than the model's is taken if the
    model's joints can be named in it (--joints); further joints are ignored. A Parquet output has
    one interaction per sample: person_a is the partner, person_b the reaction. BVH outputs are one
    file per person and sample, NAME_0_A.bvh the partner and NAME_0_B.bvh the reaction, with the
    joints of the model and constant bone lengths, in metres, y up unless --to-unit and --to-up say
    otherwise. Reactions are finished: bones have exact lengths, feet in stance do not slide, and
    the contacts that are predicted are closed; --no-finish leaves them as generated.

    A model may have been trained with labels of actions (package_labelled in a checkout): --action
    names one, where the partner's motion leaves several open.

    --temperature 0.6 samples nearer to what is most usual, where a reaction of each kind is not
    wanted.

    --touch right-hands keeps the reactions in which the right hands touch, as in a handshake, and
    samples until there are as many as --samples asks for. embrace is for hugs.
    --within-limits keeps those that are within every limit of the table that is printed, before
    they are fitted to a rig.

    The body of a reaction is the model's choice. --body partner gives it the partner's bone
    lengths, --body captured those of the other person of the capture. --rig names a BVH file of the
    person who reacts: the reaction is finished with that body's bone lengths, and BVH files are on
    its hierarchy, in its unit and axes. --from-unit, --from-up and --joints with b= before the
    value are of this file (with a= where the partner is person b).

    --stream reacts frame by frame. A frame is a line: the time in seconds, then x y z of every
    joint in the order of the model, in metres, y up; or JSON, {"time": 0.1, "pose": [[x, y, z],
    ...]}. The reaction is a line of the same format, {"time": 0.1, "reactions": [[[x, y, z], ...],
    ...]}, or the time and the numbers of all samples in order. The joints are listed on standard
    error. ``python -m benchmarks.operator`` measures the latency, which is a few milliseconds.
    """
    options = ReadOptions(form, preset, from_unit, from_up, from_fps, joints)
    torch.set_num_threads(1)
    with reading_errors_in_one_line():
        chosen = check_request(samples, options, weights)
        random = torch.Generator().manual_seed(seed)
        if stream:
            given = {"PARTNER": partner, "--out": out, "--clip": clip, "--rig": rig, "--body": body}
            of_files = {"--to-unit": to_unit, "--to-up": to_up, "--to-fps": to_fps}
            of_files |= {"--person": person, "--touch": touch, "--within-limits": within_limits}
            _check_stream({**given, **of_files, **options.given()})
            live = {"n_samples": samples, "random": random, "action": action, "finish": finish}
            _stream(_load(chosen, temperature, samples), chosen, live)
            return
        file, out = _check_files(partner, out, {} if finish else {"--rig": rig, "--body": body})
        name = clip or capture_name(file)
        check_reactions_output(out, _space(to_unit, to_up, OutputSpace()))
        check_outputs(out, output_files(out, name, samples), filter(None, (file, rig)))
        model, source = _load(chosen, temperature, samples), Source(file, person or "a", person)
        told = _action_line(model, action)
        people = read_reacting_people(source, rig, model.skeleton, options, clip, body)
        typer.echo(
            trained_on_line(chosen, synthetic_capture=is_synthetic(file, clip))
            + told
            + _length_line(model, people.partner)
        )
        capture = people.partner if to_fps is None else _at_meant_times(people.partner)
        at = _sample_times(capture, to_fps, name)
        check_total(samples, len(at), len(model.skeleton.joints))
        partner_motion = PartnerMotion(capture.motion, capture.times, at, action)
        sampling = Sampling(model, partner_motion, people.body, finish, random)
        motions = _chosen(sampling, samples, touch, within_limits)
        space = _space(to_unit, to_up, people.space)
        reactions = Reactions(
            name, model.skeleton, at - at[0],
            sample_poses(Spline(capture.times, capture.motion), at), motions,
            people.rig, people.copied_partner(at, space), people.body_text,
        )  # fmt: skip
        _write(reactions, out, space)


def _action_line(model: ReactionModel, action: str) -> str:
    """Say in a further line which action a model is told, or may be told; nothing if it takes none.

    Raises
    ------
    CommandError
        If no label, or more than one, has the words.
    """
    known = known_actions(model)
    if action and not known:
        raise CommandError(
            f"--action {action}: the weights were not trained with labels of actions; leave it "
            "out, or name others by --weights"
        )
    try:
        told = action_index(model, action)
    except ValueError as fault:
        raise CommandError(f"--action: {fault}") from fault
    if action:
        return f"\nthe action is told: {known[told]}"
    others = ", ".join(label for label in known if label)
    return f"\nthe action is not told; --action may name one of: {others}" if others else ""


def _length_line(model: ReactionModel, capture: PersonMotion) -> str:
    """Say in a further line that a capture is longer than an action of the training."""
    seconds = float(np.ptp(capture.times))
    if seconds <= max_duration(model.normalisation):
        return ""
    return (
        f"\nthe capture lasts {seconds:.1f} s, an action of the training about "
        f"{mean_duration(model.normalisation):.1f} s: it is answered in windows of that length; "
        "pacmo export --seconds cuts out one action"
    )


@dataclass(frozen=True)
class Sampling:
    """How reactions to a partner are generated.

    Parameters
    ----------
    model, partner : ReactionModel, PartnerMotion
    body : of who reacts; None for the model's choice
    finish : whether reactions are finished
    random : generator of the noise
    """

    model: ReactionModel
    partner: PartnerMotion
    body: TargetBody | None
    finish: bool
    random: torch.Generator

    def draw(self, samples: int = 1) -> Motion:
        """Generate the next reactions, ``(S, T, J, 3)`` metres."""
        motions = react_all(self.model, [self.partner], n_samples=samples, random=self.random)[0]
        if not self.finish:
            return motions
        return finish_reactions(self.model, self.partner, motions, self.body)

    def draw_all(self, samples: int) -> Motion:
        """Generate reactions, each the same to the bit however many there are.

        In a batch of another size sums are rounded otherwise, by a micrometre, of which the
        rotations of a rig may make millimetres.
        """
        if is_deterministic(self.model):
            return self.draw(samples)
        return np.concatenate([self.draw() for _ in range(samples)])


def _chosen(
    sampling: Sampling, samples: int, touch: TouchName | None, within_limits: bool
) -> Motion:
    """Generate reactions; of those that are asked for only, and say how many others there were."""
    skeleton, times = sampling.model.skeleton, sampling.partner.out_times
    partner = sample_poses(Spline(sampling.partner.times, sampling.partner.motion), times)
    tests: dict[str, Callable[[Motion], bool]] = {}
    if touch:
        try:
            check_hands(touch, skeleton)
        except ValueError as fault:
            raise CommandError(f"--touch {fault}") from fault
        tests[f"--touch {touch}"] = lambda drawn: is_as_asked(
            touch, skeleton, times, partner, drawn[0]
        )
    if within_limits:
        tests["--within-limits"] = lambda drawn: is_within_limits(
            skeleton, times, partner, drawn[0]
        )
    if not tests:
        return sampling.draw_all(samples)
    if samples > MAX_DRAWN:
        raise CommandError(f"{', '.join(tests)}: --samples must be 1 to {MAX_DRAWN}; got {samples}")
    if gives_one(sampling.model):
        raise CommandError(f"{', '.join(tests)}: there is one reaction to choose from")
    kept, drawn, passed = draw_until(sampling.draw, tests, samples)
    names = [f"{name} ({number})" if len(tests) > 1 else name for name, number in passed.items()]
    text = f"{len(kept)} of {drawn} reactions pass {' and '.join(names)}"
    if len(kept) < samples:
        fewer = (
            f"; --samples {len(kept)} writes those"
            if kept
            else ": the model expects nothing of the kind; leave the option out, or try another "
            "--touch or part of the capture (pacmo export --seconds)"
        )
        raise CommandError(f"{text}; wanted {samples}{fewer}")
    typer.echo(f"{text}; the others are dropped")
    return np.concatenate(kept)


def _write(reactions: Reactions, out: Path, space: OutputSpace) -> None:
    """Write the files; say what they are and how well they hold the motion; last, how it is."""
    if reactions.rig and not is_parquet(out):
        frames = f"{len(reactions.samples)} x {len(reactions.times)} frames"
        rig = reactions.rig
        typer.echo(f"fitting {frames} to the {len(rig.joints)} joints of {rig.file} ...")
    written = write_reactions(reactions, out, space)
    typer.echo(files_line(reactions, written.files, space))
    if written.fidelity.is_of_files:
        typer.echo(written.fidelity.line())
    sole = 0.0 if is_parquet(out) else reactions.sole
    for line in motion_lines(
        reactions.skeleton,
        reactions.times,
        reactions.partner,
        written.samples,
        written.in_files,
        sole,
    ):
        typer.echo(line)


def _space(to_unit: str | None, to_up: str | None, default: OutputSpace) -> OutputSpace:
    return OutputSpace(
        default.unit if to_unit is None else parse_unit(to_unit, "--to-unit"),
        default.up if to_up is None else to_up,
    )


def _check_files(
    partner: list[Path], out: Path | None, bodies: Mapping[str, object]
) -> tuple[Path, Path]:
    """Return the partner and the output; refuse a second capture, and bodies without the finish."""
    for option, body in bodies.items():
        if body:
            raise CommandError(f"{option} {body}: the finish makes the body; leave out --no-finish")
    if not partner or out is None:
        missing = "--out" if partner else "a PARTNER and --out, or --stream"
        raise CommandError(f"give {missing}")
    parts = [str(file) for file in partner] if len(partner) > 1 else str(partner[0]).split("+")
    if len(partner) > 1 or (len(parts) > 1 and not partner[0].exists()):
        raise CommandError(
            "react takes one partner and generates the other person; got "
            f"{' and '.join(parts)}: name one of them, or, to change the bodies of two captured "
            "people, use pacmo augment or pacmo vary"
        )
    return partner[0], out


def _at_meant_times(capture: PersonMotion) -> PersonMotion:
    several = len(capture.times) > 1
    return replace(capture, times=meant_times(capture.times)) if several else capture


def _sample_times(capture: PersonMotion, fps: float | None, name: str) -> NDArray[np.float64]:
    """Return the times of the frames of the reaction."""
    if len(capture.times) < MIN_FRAMES:
        raise CommandError(f"{name}: wanted {MIN_FRAMES} frames or more; got {len(capture.times)}")
    if fps is None:
        return capture.times
    try:
        return sample_times(capture.times, fps)
    except ValueError as fault:
        raise CommandError(f"{name}, --to-fps: {fault}") from fault


def check_samples(samples: int) -> None:
    """Refuse more samples than one command generates."""
    if samples > MAX_SAMPLES:
        raise CommandError(f"--samples must be 1 to {MAX_SAMPLES}; got {samples}")


def check_request(samples: int, options: ReadOptions, weights: Path | None) -> Path:
    """Check what takes no time, before captures are read; return the weights that are used."""
    check_samples(samples)
    options.check()
    return find_weights(weights)


def check_total(samples: int, frames: int, joints: int) -> None:
    """Refuse an output that would not fit into memory."""
    most = 4 * MAX_POSITIONS // joints
    if samples * frames > most:
        wanted = f"wanted at most {most} frames of {joints} joints in all samples"
        raise CommandError(f"{wanted}; got {samples} x {frames}")


def _check_stream(given: Mapping[str, object]) -> None:
    """Refuse options of files, by their names, where frames come from standard input."""
    refused = [name for name, value in given.items() if value not in (None, "", [], False)]
    if refused:
        raise CommandError(
            f"--stream reads frames in metres, y up, from standard input; leave out "
            f"{', '.join(refused)}"
        )


def _load(weights: Path, temperature: float | None, samples: int) -> ReactionModel:
    """Read a model, and set the temperature of its noise if one is given."""
    if temperature == 0 and samples > 1:
        raise CommandError(f"--temperature 0 gives one reaction; leave out --samples {samples}")
    model = load_reaction_model(weights)
    if temperature is None:
        return model
    try:
        set_temperature(model, temperature)
    except ValueError as fault:
        raise CommandError(f"--temperature: {fault}") from fault
    return model


def _stream(model: ReactionModel, weights: Path, options: dict[str, Any]) -> None:
    told = _action_line(model, options["action"])
    live, skeleton = ReactionStream(model, **options), model.skeleton
    typer.echo(f"joints: {' '.join(skeleton.joints)}", err=True)
    typer.echo(trained_on_line(weights, synthetic_capture=None) + told, err=True)
    lines = iter(lambda: sys.stdin.readline(MAX_LINE), "")
    for line in react_to_lines(lines, live, skeleton):
        sys.stdout.write(f"{line}\n")
        sys.stdout.flush()
