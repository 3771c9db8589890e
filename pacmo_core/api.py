"""The library in a notebook: load, synthesise, train, save, react, retarget, evaluate, view.

Settings are those of ``params.yaml`` (in a checkout the present one) unless an argument says
otherwise. Every function checks its
arguments and raises a ``TypeError`` or ``ValueError`` of one line that names the argument, what was
wanted and what was got. ``import pacmo_core`` offers all of them.
"""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError
from ruamel.yaml import YAML
from torch import nn

from pacmo_core.augmentation.bodies import measure_body, profile_scales, segment_scales
from pacmo_core.augmentation.plan import check_scale
from pacmo_core.data.interaction import Interaction, Motion
from pacmo_core.data.posture import UNIT_WORDS
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.figures.viewer import MAX_CLIPS, Scene, render_viewer
from pacmo_core.formats.base import read_capture
from pacmo_core.formats.inference import implausible, infer_settings, states_unit_or_axis
from pacmo_core.formats.joint_names import UNSTATED, name_joints
from pacmo_core.formats.registry import (
    DEFAULT_SETTINGS,
    FORMATS,
    ONE_PERSON_FORMATS,
    PersonMotion,
    format_of,
    holds_one_person,
    open_format,
    read_partner,
)
from pacmo_core.interaction_mesh import Scene as MeshScene
from pacmo_core.interaction_mesh import Settings, prepare
from pacmo_core.interaction_mesh import retarget as retarget_scene
from pacmo_core.metrics.displacement import ape, ave
from pacmo_core.metrics.diversity import diversity
from pacmo_core.metrics.f2id import f2id
from pacmo_core.metrics.mmd import median_bandwidth as kernel_bandwidth
from pacmo_core.metrics.mmd import mmd_a, mmd_s
from pacmo_core.metrics.reactions import stack_motions
from pacmo_core.metrics.touching import TouchName, check_hands, draw_until, is_as_asked
from pacmo_core.models import MODELS, Model, load_reaction_model
from pacmo_core.reaction.autoencoder import Autoencoder, encode_features
from pacmo_core.reaction.baselines import Gru
from pacmo_core.reaction.data import to_partner_frame
from pacmo_core.reaction.inference import PACKAGED, finish_reactions, react_all
from pacmo_core.reaction.windows import (
    PartnerMotion,
    ReactionModel,
    gives_one,
    set_temperature,
)
from pacmo_core.store.files import default_params_file, merge_params, write_text
from pacmo_core.store.motions import stream_motions
from pacmo_core.store.weights import write_weights
from pacmo_core.synthesis import ACTIONS, sample_interaction, sample_scripts
from pacmo_core.training.devices import resolve_device
from pacmo_core.training.loop import TrainingData
from pacmo_core.training.state import model_config, model_state

Clips = Sequence[Interaction] | Mapping[str, Interaction]


def default_settings(section: str) -> dict[str, Any]:
    """Read one section of ``params.yaml``: of the package, or the present one of a checkout.

    Raises
    ------
    ValueError
        If there is no such section.
    """
    _check("section", section, str)
    params = _default_params()
    sections = [name for name, values in params.items() if isinstance(values, dict)]
    if section not in sections:
        raise ValueError(f"section must be one of {', '.join(sections)}; got {section!r}")
    return dict(params[section])


def load_clips(
    folder: str | Path,
    format: str | None = None,  # noqa: A002  # the name of the option everywhere
    **settings: Any,
) -> dict[str, Interaction]:
    """Load two-person clips.

    Parameters
    ----------
    folder : of Parquet, such as ``data/clips``, or of raw captures in a format
    format : of raw captures: ntu, sbu, bvh, cmu, ...; None for Parquet
    settings : of the format, such as ``fps=30.0``; others are those of the datasets' publications.
        BVH files state neither unit nor axis: ``preset="duo_mocap"``, or ``unit=0.01, up="y"``

    Returns
    -------
    interactions by name: metres, y up, seconds

    Raises
    ------
    FormatError
        If a capture is broken: with the file, the line and the reason.
    ValueError
        If there is no such format or folder, or a setting is wrong.
    """
    path = Path(_check("folder", folder, str, Path))
    if not path.is_dir():
        raise ValueError(f"folder must be an existing folder; got {str(folder)!r}")
    if format is None:
        return dict(stream_motions(path / "motions.parquet"))
    if format not in FORMATS:
        raise ValueError(f"format must be one of {', '.join(FORMATS)}; got {format!r}")
    reader = open_format(format, {**DEFAULT_SETTINGS[format], **settings})
    return {
        sequence.name: read_capture(reader, sequence).interaction for sequence in reader.find(path)
    }


@contextmanager
def _python_words() -> Iterator[None]:
    """Name arguments in place of a command's options in an error: ``(person=)`` for --person."""
    try:
        yield
    except ValueError as fault:
        text = re.sub(r"\(--(\w+)\)", r"(\1=)", str(fault))
        if text == str(fault):
            raise
        raise ValueError(text) from fault


def load_person(
    file: str | Path,
    *,
    person: str | None = None,
    format: str | None = None,  # noqa: A002
    **settings: Any,
) -> PersonMotion:
    """Load one person of a capture, to react to; unit and upward axis are inferred if need be.

    Parameters
    ----------
    file : a capture, such as ``walk.bvh``
    person : ``a`` or ``b`` of a file of two people
    format : bvh, ntu, sbu, ...; None for that of the file's suffix
    settings : of the format, such as ``unit="cm", up="z"``, or the metres of a unit

    Returns
    -------
    the joints of the file, metres, y up, seconds

    Raises
    ------
    FormatError
        If the capture is broken: with the file, the line and the reason.
    ValueError
        If the format, a setting or the person is wrong, the motion does not show the unit or the
        axis, or gives a person of impossible size or posture.
    """
    path = Path(_check("file", file, str, Path))
    with _python_words():
        name = format or format_of(path)
    if name not in FORMATS:
        raise ValueError(f"format must be one of {', '.join(FORMATS)}; got {name!r}")
    if isinstance(settings.get("unit"), str):
        if settings["unit"] not in UNIT_WORDS:
            raise ValueError(
                f"unit must be metres or {', '.join(UNIT_WORDS)}; got {settings['unit']!r}"
            )
        settings["unit"] = UNIT_WORDS[settings["unit"]]
    if "unit" in settings:
        _check("unit", settings["unit"], int, float)
    inferred = infer_settings(path, name, settings)
    unseen = [key for key, value in inferred.settings.items() if value is None]
    if unseen:
        limbs = ", ".join(inferred.missing)
        why = f"{limbs} are not recognised among its joints" if limbs else "its motion shows none"
        raise ValueError(f"{path}: wanted {' and '.join(unseen)} as a setting: {why}")
    used = {**settings, **inferred.settings}
    if person and (name in ONE_PERSON_FORMATS or holds_one_person(path, name, used)):
        raise ValueError(f"{path} holds one person: person must be None; got {person!r}")
    with _python_words():
        loaded = read_partner(path, name, used, person=person, clip="")
    if states_unit_or_axis(FORMATS[name]) and (
        fault := implausible([(loaded.skeleton, loaded.motion)], [used.get("up")])
    ):
        raise ValueError(f"{path}: {fault[1]}: wrong unit or up")
    return loaded


def synthesise(n: int, *, random_seed: int = 7) -> dict[str, Interaction]:
    """Sample clips of the embedded default, whose distribution of reactions is known.

    Parameters
    ----------
    n : how many; eleven actions by each pair of people
    random_seed : of the population and of every clip

    Returns
    -------
    interactions by name: 25 Kinect joints, 30 frames a second
    """
    _check_positive("n", n)
    _check_seed(random_seed)
    scripts = sample_scripts(
        random_seed,
        population=random_seed,
        pairs=-(-n // len(ACTIONS)),
        actions=tuple(ACTIONS),
        replications=1,
    )
    return {
        f"{script.action}-{script.pair}": sample_interaction(script, random)
        for script, random in islice(scripts, n)
    }


def train(  # noqa: PLR0913  # each is a choice of the caller
    name: str,
    clips: Clips,
    *,
    validation: Clips = (),
    actions: Sequence[str] = (),
    validation_actions: Sequence[str] = (),
    random_seed: int = 1,
    device: str = "cpu",
    **settings: Any,
) -> nn.Module:
    """Train a model of reactions or a feature extractor.

    Parameters
    ----------
    name : pacmo or a variant of it, pacmo_paper, regression, gru, flow_matching, autoencoder or
        matcher
    clips : training clips, a sequence or a mapping by name, all of one skeleton
    validation : on which the weights are selected; without, the last epoch's are taken
    actions, validation_actions : label of each clip, for a model that is conditioned on labels
    random_seed : of weights, batches and noise
    device : cpu, cuda or auto (cuda if available)
    settings : that replace those of the model's section of ``params.yaml``, such as ``n_epochs=5``
    """
    _check_model_name(name)
    training = _check_clips("clips", clips)
    held_out = _check_clips("validation", validation, least=0)
    _check_same_skeleton("validation", held_out, training)
    _check_seed(random_seed)
    resolved = resolve_device(device)
    model = MODELS[name]
    if actions and not model.uses_actions:
        raise ValueError(f"actions must be empty for {name}, which has no labels; got {actions!r}")
    section = _training_section(model, settings) | {"random_seed": random_seed}
    options = _validated(f"settings of {name}", model.settings_class(), section)
    labels = _labels("actions", actions, training)
    held_out_labels = _labels("validation_actions", validation_actions, held_out)
    if actions and len(held_out) > len(validation_actions):
        raise ValueError(f"validation_actions must be one for each clip, {len(held_out)}; got none")
    data = TrainingData(training, held_out, labels, held_out_labels)
    trained: nn.Module = model.build_training(data, options, device=resolved).finish()
    return trained


def _labels(argument: str, labels: Sequence[str], clips: Sequence[Interaction]) -> list[str]:
    """Return a label of each clip, empty without labels."""
    if labels and len(labels) != len(clips):
        raise ValueError(f"{argument} must be one for each clip, {len(clips)}; got {len(labels)}")
    return list(labels) or [""] * len(clips)


def save(name: str, model: nn.Module, path: str | Path) -> Path:
    """Write a trained model's weights and configuration as safetensors; ``react`` reads the file.

    Parameters
    ----------
    name : of the model, as for ``train``
    model : trained
    path : of the file

    Returns
    -------
    the path
    """
    _check_model_name(name)
    file = Path(_check("path", path, str, Path))
    _check("model", model, nn.Module)
    try:
        config, state = model_config(model), model_state(model)
        MODELS[name].read(config, state)
    except (AttributeError, KeyError, TypeError, RuntimeError):
        kind = type(model).__name__
        raise ValueError(f"model must be a trained {name}; got {kind}") from None
    write_weights(file, {"model": name, "config": config}, state)
    return file


def react(  # noqa: PLR0913  # each is a choice of the caller
    model: ReactionModel | str | Path | None,
    partner: Interaction | PersonMotion,
    *,
    person: str = "a",
    action: str = "",
    n_samples: int = 1,
    random_seed: int = 1,
    temperature: float | None = None,
    touch: str = "",
    finish: bool = True,
) -> list[Interaction]:
    """Generate reactions to one person of a clip, at the clip's frames.

    Parameters
    ----------
    model : trained, or the path of its ``weights.safetensors``; None for the weights in the package
    partner : the clip, or what ``load_person`` returns; of other joints than the model's, those of
        the model are named in it, or estimated from the joints around them
    person : ``a`` or ``b``, who is the partner in a clip; the other's motion is not read
    action : of the interaction, a label that the model was trained with or words of one; empty
        where it is not known
    n_samples : how many; 1 for a deterministic model, and at temperature 0
    random_seed : of the noise
    temperature : standard deviation of the noise, below 1 for more alike and usual reactions; None
        for the model's
    touch : what touches in each for 0.1 s or more, of ``right-hands``, ``left-hands``, ``hands``,
        ``embrace``, ``body`` (a hand the partner's body), ``by-partner`` (the partner's hand the
        reaction's) and ``no-hands``: others are dropped and further ones sampled, 128 at most;
        empty for all
    finish : whether bones get exact lengths, feet are planted and predicted contacts closed

    Returns
    -------
    interactions: ``person_a`` the partner, ``person_b`` the reaction, of the model's joints

    Raises
    ------
    ValueError
        If an argument is wrong, a joint of the model cannot be named in the partner's, or fewer
        reactions than are wanted touch so.
    """
    _check("partner", partner, Interaction, PersonMotion)
    _check_positive("n_samples", n_samples)
    if person not in ("a", "b"):
        raise ValueError(f"person must be a or b; got {person!r}")
    _check_seed(random_seed)
    chosen = PACKAGED if model is None else model
    loaded = load_reaction_model(chosen) if isinstance(chosen, str | Path) else chosen
    if not isinstance(loaded, ReactionModel):
        raise TypeError(f"model must generate reactions; got {type(model).__name__}")
    seen = _in_joints(partner, person, loaded.skeleton)
    random = torch.Generator().manual_seed(random_seed)
    seen_motion = PartnerMotion(seen.motion, seen.times, seen.times, action)

    def draw(samples: int = 1) -> Motion:
        (motions,) = react_all(loaded, [seen_motion], n_samples=samples, random=random)
        return finish_reactions(loaded, seen_motion, motions) if finish else motions

    with _at_temperature(loaded, temperature):
        if gives_one(loaded) and (touch or n_samples != 1):
            wanted = f"n_samples must be 1 and touch empty; got {n_samples} and {touch!r}"
            raise ValueError(f"a deterministic model, or temperature 0, has one reaction: {wanted}")
        motions = _touching(draw, touch, n_samples, seen) if touch else draw(n_samples)
    return [Interaction(seen.skeleton, seen.times, seen.motion, motion) for motion in motions]


def _touching(draw: Callable[[], Motion], touch: str, count: int, partner: PersonMotion) -> Motion:
    """Draw reactions until enough of them touch as asked."""
    if touch not in [name.value for name in TouchName]:
        raise ValueError(f"touch must be one of {', '.join(TouchName)}; got {touch!r}")
    name = TouchName(touch)
    check_hands(name, partner.skeleton)

    def touches(drawn: Motion) -> bool:
        return is_as_asked(name, partner.skeleton, partner.times, partner.motion, drawn[0])

    kept, drawn, _ = draw_until(draw, {touch: touches}, count)
    if len(kept) < count:
        raise ValueError(f"touch {touch}: wanted {count} reactions; {len(kept)} of {drawn} do so")
    return np.concatenate(kept)


def retarget(
    clip: Interaction,
    *,
    a: Mapping[str, float] | str | None = None,
    b: Mapping[str, float] | str | None = None,
) -> Interaction:
    """Give the two people other bone lengths and keep their interaction (InteractionMesh).

    Parameters
    ----------
    clip : the source
    a, b : of person a and b: scales by segment, such as ``{"left_forearm": 1.2}`` or
        ``{"uniform": 0.8}``; or the name of a profile, such as ``"child"``; None to keep the body

    Raises
    ------
    ValueError
        If neither body changes, or a segment or profile is not known: with those that are.
    """
    _check("clip", clip, Interaction)
    if not a and not b:
        raise ValueError("a and b must not both be None or empty: one body must change")
    scales = [
        _scales(name, change, motion, clip)
        for name, change, motion in (("a", a, clip.person_a), ("b", b, clip.person_b))
    ]
    section = default_settings("augment")["solver"]
    solver = _validated("settings of the solver", Settings, section)
    scene = MeshScene((clip.person_a, clip.person_b), (clip.skeleton,) * 2, clip.fps)
    (points,) = retarget_scene(prepare(scene, solver), np.concatenate(scales)[None]).points
    people = np.split(points.astype(np.float32), [len(clip.skeleton.joints)], axis=1)
    person_a, person_b = (np.ascontiguousarray(person) for person in people)
    return replace(clip, person_a=person_a, person_b=person_b)


def evaluate(
    real: Clips,
    generated: Clips,
    *,
    extractor: Autoencoder | None = None,
    random_seed: int = 1,
    **settings: Any,
) -> dict[str, float]:
    """Compare generated reactions with the real ones to the same partners.

    Parameters
    ----------
    real, generated : n clips each, ``person_a`` the partner, at the same times; two mappings are
        paired by name, sequences by order. Of other joints than the generated ones, the real ones
        are expressed in these, as ``react`` does
    extractor : the auto-encoder of the features; None to train one on ``real``
    random_seed : of the extractor and of the pairs of the diversity
    settings : of the extractor's training, such as ``n_epochs=20``

    Returns
    -------
    ``f2id``, ``mmd_a``, ``mmd_s``, ``diversity`` and ``diversity_real``, ``ape`` (m) and ``ave``
    (m²) of the root; pacmo_core/metrics/catalogue.py says what each is
    """
    _check_seed(random_seed)
    if isinstance(real, Mapping) and isinstance(generated, Mapping):
        differing = sorted(real.keys() ^ generated.keys())
        if differing:
            raise ValueError(f"generated must have the clips of real; differs in {differing[0]!r}")
        generated = {name: generated[name] for name in real}
    checked = [
        _check_clips(name, clips, least=2)
        for name, clips in (("real", real), ("generated", generated))
    ]
    if len(checked[0]) != len(checked[1]):
        n_real, n_generated = map(len, checked)
        raise ValueError(f"generated must have {n_real} clips, as real; got {n_generated}")
    checked[0] = [_clip_in_joints(clip, checked[1][0].skeleton) for clip in checked[0]]
    first, second = ([to_partner_frame(clip) for clip in clips] for clips in checked)
    if extractor is not None:
        _check("extractor", extractor, Autoencoder)
    else:
        settings = {"random_seed": random_seed, **settings}
        extractor = _check("extractor", train("autoencoder", first, **settings), Autoencoder)
    features = [encode_features(extractor, clips) for clips in (first, second)]
    weights = np.full(features[0].shape[-1], 1 / features[0].shape[-1])
    x, y = (_stacked(clips) for clips in (first, second))
    codes = np.arange(len(first))
    bandwidths = kernel_bandwidth(x), kernel_bandwidth(x.reshape(len(x), 1, -1))
    random = [np.random.default_rng(random_seed) for _ in range(2)]
    root = first[0].skeleton.root
    motions = [[clip.person_b for clip in clips] for clips in (second, first)]
    return {
        "f2id": f2id(features[0], features[1], weights),
        "mmd_a": mmd_a(x, y, codes, codes, bandwidth=bandwidths[0]),
        "mmd_s": mmd_s(x, y, codes, codes, bandwidth=bandwidths[1]),
        "diversity": diversity(features[1], weights, squared=True, generator=random[0]),
        "diversity_real": diversity(features[0], weights, squared=True, generator=random[1]),
        "ape": float(ape(*motions, weighting="sequence")[root]),
        "ave": float(ave(*motions, weighting="sequence")[root]),
    }


def view(clips: Mapping[str, Interaction], path: str | Path) -> Path:
    """Write a page that plays clips side by side in 3-D; it opens without a network.

    Parameters
    ----------
    clips : by label, one to six
    path : of the page, such as ``view.html``
    """
    _check("clips", clips, Mapping)
    if not 1 <= len(clips) <= MAX_CLIPS:
        raise ValueError(f"clips must be 1 to {MAX_CLIPS}; got {len(clips)}")
    file = Path(_check("path", path, str, Path))
    scenes = [
        Scene.of(_check("label", label, str), _check(label, clip, Interaction))
        for label, clip in clips.items()
    ]
    contact = default_settings("evaluate_pacmo")["contact_distance"]
    write_text(file, render_viewer(scenes, contact=contact))
    return file


@cache
def _default_params() -> dict[str, Any]:
    params: dict[str, Any] = YAML(typ="safe").load(default_params_file())
    return params


def _in_joints(
    partner: Interaction | PersonMotion, person: str, skeleton: Skeleton
) -> PersonMotion:
    """Return one person on the joints of a model."""
    if isinstance(partner, Interaction):
        motion = partner.person_a if person == "a" else partner.person_b
        partner = PersonMotion(partner.skeleton, partner.times, motion)
    if partner.skeleton == skeleton:
        return partner
    named = name_joints(partner.skeleton, skeleton, UNSTATED, estimates=True)
    return PersonMotion(skeleton, partner.times, named.apply(partner.motion))


def _clip_in_joints(clip: Interaction, skeleton: Skeleton) -> Interaction:
    """Return both people of a clip on the joints of a skeleton."""
    person_a, person_b = (_in_joints(clip, person, skeleton).motion for person in ("a", "b"))
    return replace(clip, skeleton=skeleton, person_a=person_a, person_b=person_b)


@contextmanager
def _at_temperature(model: ReactionModel, temperature: float | None) -> Iterator[None]:
    """Set the temperature of a model's noise for a while."""
    if temperature is None:
        yield
        return
    before = 1.0 if isinstance(model, Gru) else float(model.temperature)
    set_temperature(model, _check("temperature", temperature, int, float))
    try:
        yield
    finally:
        set_temperature(model, before)


def _training_section(model: Model, settings: Mapping[str, Any]) -> dict[str, Any]:
    """Override a section; epochs that others count from follow the number of epochs."""
    default = default_settings(model.section)
    default.pop("threads")
    if "start" in default:
        # Not that of the checkout's experiment, which is a path there.
        default["start"] = {**default["start"], "weights": "", "sha256": ""}
    if model.changes:
        section_of_variants, _, variant = model.changes.partition(".")
        default = merge_params(default, default_settings(section_of_variants)[variant])
    section: dict[str, Any] = {**default, **settings}
    n_epochs = section["n_epochs"]
    if isinstance(n_epochs, int) and n_epochs != default["n_epochs"]:
        counts = {"validate_from", "warmup_epochs", "cooldown_epochs"}
        for key in counts & (default.keys() - settings.keys()):
            section[key] = default[key] * n_epochs // default["n_epochs"]
    return section


def _scales(
    name: str, change: Mapping[str, float] | str | None, motion: NDArray[np.float32], clip: Any
) -> NDArray[np.float64]:
    body = measure_body(motion, clip.skeleton)
    _check(name, change or {}, str, Mapping)
    try:
        if isinstance(change, str):
            return profile_scales(body, change)
        for segment, scale in (change or {}).items():
            check_scale(f"the scale of {segment}", _check(segment, scale, int, float))
        return segment_scales(body, dict(change or {}))
    except (KeyError, ValueError) as error:
        raise ValueError(f"{name}: {error.args[0]}") from None


def _stacked(clips: Sequence[Interaction]) -> NDArray[np.float64]:
    motions, times = [clip.person_b for clip in clips], [clip.times for clip in clips]
    return stack_motions(motions, times, default_settings("evaluate_pacmo")["n_frames"])


def _validated(what: str, kind: type[Any], values: Mapping[str, Any]) -> Any:
    known = set(kind.__dataclass_fields__)
    unknown = sorted(set(values) - known)
    if unknown:
        raise ValueError(f"{what}: wanted {', '.join(sorted(known))}; got {', '.join(unknown)}")
    try:
        return TypeAdapter(kind).validate_python(dict(values))
    except ValidationError as fault:
        first = fault.errors()[0]
        key = ".".join(map(str, first["loc"])) or what
        if first["type"] == "value_error":  # a dataclass's own check, which names the values
            raise ValueError(f"{key}: {first['ctx']['error']}") from None
        raise ValueError(f"{key}: {first['msg']}; got {first['input']!r}") from None


def _check(name: str, value: Any, *kinds: type) -> Any:
    if not isinstance(value, kinds) or isinstance(value, bool):
        wanted = " or ".join(kind.__name__ for kind in kinds)
        raise TypeError(f"{name} must be {wanted}; got {type(value).__name__}")
    return value


def _check_positive(name: str, value: Any) -> None:
    if _check(name, value, int) < 1:
        raise ValueError(f"{name} must be at least 1; got {value}")


def _check_model_name(name: str) -> None:
    known = [model.name for model in MODELS.values() if model.kind in ("reaction", "features")]
    if name not in known:
        raise ValueError(f"name must be one of {', '.join(known)}; got {name!r}")


def _check_clips(name: str, clips: Any, least: int = 1) -> list[Interaction]:
    """Check that clips are interactions of one skeleton, enough of them."""
    _check(name, clips, Sequence, Mapping)
    if isinstance(clips, Mapping):
        clips = list(clips.values())
    for number, clip in enumerate(clips):
        _check(f"{name}[{number}]", clip, Interaction)
    if len(clips) < least:
        raise ValueError(f"{name} must be at least {least} clips; got {len(clips)}")
    _check_same_skeleton(name, clips, clips)
    return list(clips)


def _check_same_skeleton(
    name: str, clips: Sequence[Interaction], others: Sequence[Interaction]
) -> None:
    for number, clip in enumerate(clips):
        if clip.skeleton != others[0].skeleton:
            raise ValueError(
                f"{name} must be of one skeleton, {others[0].skeleton.name}; "
                f"{name}[{number}] is of {clip.skeleton.name}"
            )


def _check_seed(random_seed: Any) -> None:
    if _check("random_seed", random_seed, int) < 0:
        raise ValueError(f"random_seed must not be negative; got {random_seed}")
