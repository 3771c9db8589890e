"""The joints of a model by their names in a capture of another skeleton.

A joint of the model is one joint of the capture, or the mean of several: by equal names, by the
rigs of ``formats.rigs``, or as the user states it in a word or a file. What a capture of few joints
lacks, such as wrists and toes, is estimated from the joints around it.
"""

import csv
import difflib
import json
import tomllib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.interaction import Motion
from pacmo_core.data.limits import MAX_JOINTS, printable
from pacmo_core.data.skeleton import Skeleton, bare_names, mirror_by_name
from pacmo_core.formats.base import read_content
from pacmo_core.formats.rigs import (
    ESTIMATES,
    RIGS,
    SIDES,
    Rig,
    contained_rigs,
    fitting_rigs,
    plain_name,
    plain_names,
    rig_of_model,
)

FILE_SUFFIXES = (".json", ".toml", ".csv")
# A hand that a rig lacks, beyond the wrist along the forearm, in lengths of the forearm.
HAND_REACH = 1 / 3
# Metres ahead of the ankle and below it at which toes are put that a capture lacks.
TOES_AHEAD, TOES_BELOW = 0.12, 0.04
# Points of a body that show its stature and posture, as most rigs name all of them: its limbs hang
# on the head, as not all have a pelvis.
_BODY_POINTS = (
    *("head", "left_hip", "left_knee", "left_ankle", "right_hip", "right_knee", "right_ankle"),
    *("left_shoulder", "left_elbow", "left_wrist", "right_shoulder", "right_elbow", "right_wrist"),
)
_BODY_PARENTS = (-1, 0, 1, 2, 0, 4, 5, 0, 7, 8, 0, 10, 11)
_BODY = Skeleton("body", _BODY_POINTS, _BODY_PARENTS, mirror_by_name(_BODY_POINTS))
_MIN_SIMILARITY = 0.65  # of names, as difflib measures it
_MAX_LISTED = 6  # joints in a message


@dataclass(frozen=True)
class StatedNames:
    """What the user states about the joints of a capture.

    Parameters
    ----------
    rig : name of a preset; empty to find the one that fits
    joints : of some of the model's joints, the capture's joints whose mean they are
    how : how the user states them, with {} for a word, in messages
    """

    rig: str = ""
    joints: dict[str, tuple[str, ...]] | None = None
    how: str = "--joints {}, or in a file"

    @property
    def option(self) -> str:
        """Where the user states them."""
        return self.how.partition(" ")[0].rstrip(":")


UNSTATED = StatedNames()


@dataclass(frozen=True)
class JointNames:
    """The joints of a model in a capture.

    Parameters
    ----------
    weights : (J, C) float64, of the capture's C joints in each of the model's; rows sum to 1. A
        joint beyond the capture's last one has a negative weight
    description : of what was matched, in words; empty where all names are equal
    toes : rows that are those of the ankles, and are put ahead of them
    hips : rows of the left and the right hip, which say where ahead is
    """

    weights: NDArray[np.float64]
    description: str
    toes: Sequence[int] = ()
    hips: Sequence[int] = ()

    def apply(self, motion: NDArray[np.floating]) -> Motion:
        """Return the positions (T, J, 3) of the model's joints in a motion (T, C, 3)."""
        selected: NDArray[np.float64] = np.einsum(
            "jc,tcx->tjx", self.weights, motion.astype(np.float64)
        )
        if self.toes:
            left, right = (selected[:, row] for row in self.hips)
            ahead = np.cross(left - right, [0, 1, 0])
            ahead /= np.maximum(np.linalg.norm(ahead, axis=-1, keepdims=True), 1e-9)
            beyond = TOES_AHEAD * ahead - [0, TOES_BELOW, 0]
            selected[:, list(self.toes)] += beyond[:, None]
        return selected.astype(np.float32)


@dataclass(frozen=True)
class _Match:
    """What names say of the joints of a model.

    Parameters
    ----------
    found : the capture's joints of each joint of the model that could be named
    description : in words; empty where all names are equal
    rig : by which they were named, if by one
    near : of ``found``, those that a rig lacks and has another joint near
    """

    found: dict[str, tuple[str, ...]]
    description: str = ""
    rig: Rig | None = None
    near: tuple[str, ...] = ()


def stated_body(
    capture: Skeleton, motion: NDArray[np.floating], stated: StatedNames
) -> tuple[Skeleton, NDArray[np.floating]]:
    """Return the points of a body by the names that the user states, by which it is measured.

    Without them, or where they do not name all of it: the capture as it is.
    """
    if not stated.rig and not stated.joints:
        return capture, motion
    joints = {name: of for name, of in (stated.joints or {}).items() if name in _BODY_POINTS}
    try:
        names = name_joints(capture, _BODY, StatedNames(stated.rig, joints))
    except ValueError:
        return capture, motion
    return _BODY, names.apply(motion)


def parse_joints(words: Sequence[str]) -> StatedNames:
    """Read presets, files, and words ``MODEL_JOINT=JOINT`` or ``MODEL_JOINT=JOINT+JOINT``.

    Raises
    ------
    ValueError
        If a word is none of them, two are presets, or a file is not a mapping of joints.
    """
    rigs = [word for word in words if word in RIGS]
    if len(rigs) > 1:
        raise ValueError(f"wanted one preset of joints; got {', '.join(rigs)}")
    joints: dict[str, tuple[str, ...]] = {}
    for word in words:
        if word in RIGS:
            continue
        name, equals, value = word.partition("=")
        if equals and name in joints:
            raise ValueError(f"{name} is stated twice, the second time as {value}")
        if equals:
            joints[name] = tuple(value.split("+"))
        elif Path(word).suffix.lower() in FILE_SUFFIXES:
            joints |= read_joints(Path(word))
        else:
            wanted = f"{', '.join(RIGS)}; a file {', '.join(FILE_SUFFIXES)}; or MODEL_JOINT=JOINT"
            raise ValueError(f"no preset of joints {word!r}; wanted {wanted}")
    return StatedNames(rigs[0] if rigs else "", joints)


def read_joints(file: Path) -> dict[str, tuple[str, ...]]:
    """Read a mapping from joints of the model to those of a capture.

    JSON and TOML: an object ``{"model_joint": "Joint"}``, a mid-point a list of joints. CSV: lines
    ``model_joint,Joint``, of a mid-point with further joints.

    Raises
    ------
    FormatError, ValueError
        If the file cannot be read, or is no such mapping: with its name.
    """
    content = read_content(file)
    try:
        text = content.decode("utf-8-sig")
        if file.suffix.lower() == ".csv":
            rows = [
                row for row in csv.reader(text.splitlines()) if row and row[0].strip()[:1] != "#"
            ]
            found: Any = {
                row[0].strip(): [word.strip() for word in row[1:] if word] for row in rows
            }
        else:
            found = json.loads(text) if file.suffix.lower() == ".json" else tomllib.loads(text)
    except (ValueError, csv.Error, RecursionError) as error:
        raise ValueError(f"{file}: no mapping of joints: {printable(str(error))[:200]}") from error
    if not isinstance(found, dict) or not 1 <= len(found) <= MAX_JOINTS:
        raise ValueError(f"{file}: wanted a mapping from joints of the model to the capture's")
    return {str(name): _listed(file, name, joints) for name, joints in found.items()}


def _listed(file: Path, name: object, joints: object) -> tuple[str, ...]:
    listed = [joints] if isinstance(joints, str) else joints
    if not isinstance(listed, list) or not listed or not all(isinstance(j, str) for j in listed):
        got = printable(repr(joints))[:60]
        raise ValueError(
            f"{file}, {name}: wanted the name of a joint, or a list of names; got {got}"
        )
    return tuple(listed)


def name_joints(
    capture: Skeleton, model: Skeleton, stated: StatedNames, *, estimates: bool = False
) -> JointNames:
    """Find the model's joints in a capture.

    Parameters
    ----------
    capture, model : skeletons
    stated : by the user
    estimates : whether joints that the capture lacks are put where the joints around them say, by
        ``rigs.ESTIMATES``, and toes ahead of the ankles

    Raises
    ------
    ValueError
        If some are not named in it: with those that are nearest by name; if several presets fit
        and differ; or if a name that is stated is no joint.
    """
    explicit = _check_stated(capture, model, stated)
    wanted = [joint for joint in model.joints if joint not in explicit]
    match = _match(capture, model, wanted, stated)
    found, rig = match.found, match.rig
    shares = {
        joint: dict.fromkeys(parts, 1 / len(set(parts)))
        for joint, parts in {**found, **explicit}.items()
    }
    _check_places(shares, explicit, model)
    missing = [joint for joint in wanted if joint not in found]
    guessed = _estimate(capture, model, missing, rig) if estimates and rig else {}
    if len(guessed) < len(missing):
        lacking = [joint for joint in missing if joint not in guessed]
        raise ValueError(_missing_text(capture, model, lacking, {**found, **explicit}, stated))
    weights = np.zeros((len(model.joints), len(capture.joints)))
    for joint, parts in {**shares, **guessed}.items():
        for part, share in parts.items():
            weights[model.joints.index(joint), capture.joints.index(part)] = share
    toes = [row for row in _rows_of("toe", model) if model.joints[row] in guessed]
    extended = _extend(weights, model, toes)
    beyond = {model.joints[row] for row in np.flatnonzero((extended != weights).any(axis=1))}
    description = match.description + _near_text(match, beyond)
    if guessed:
        description += f"; estimated from the joints around them: {', '.join(guessed)}"
    return JointNames(extended, description, toes, _rows_of("hip", model) if toes else [])


def _check_places(
    shares: Mapping[str, Mapping[str, float]], stated: Mapping[str, object], model: Skeleton
) -> None:
    """Refuse one place for two joints of which the user stated one, unless a bone joins them.

    A hand that is stated as the wrist is put beyond it.

    Raises
    ------
    ValueError
        With both, and the joints of the capture that they would be.
    """
    bones = {frozenset((model.joints[a], model.joints[b])) for a, b in model.bones.tolist()}
    for one, other in combinations([joint for joint in model.joints if joint in shares], 2):
        is_one = shares[one] == shares[other] and frozenset((one, other)) not in bones
        if is_one and {one, other} & set(stated):
            raise ValueError(f"{one} and {other} would both be {' + '.join(shares[one])}")


def _estimate(
    capture: Skeleton, model: Skeleton, missing: Sequence[str], rig: Rig
) -> dict[str, dict[str, float]]:
    """Return the shares of the capture's joints in those missing joints that they tell."""
    of_model, plain = rig_of_model(plain_names(model.joints)), _by_plain_name(capture)
    # Without hips it is not known where ahead is.
    known = set(ESTIMATES) - (set() if _rows_of("hip", model) else {f"{s}_toe" for s in SIDES})
    found: dict[str, dict[str, float]] = {}
    for joint, name in zip(model.joints, plain_names(model.joints), strict=True):
        points = of_model.points_of(name) if of_model and joint in missing else []
        shares = next((s for p in points if p in known and (s := rig.estimate_of(p, plain))), {})
        if shares:
            found[joint] = {plain[part]: share for part, share in shares.items()}
    return found


def _rows_of(point: str, model: Skeleton) -> list[int]:
    """List the model's joints that are a point of the left and of the right side."""
    of_model, names = rig_of_model(plain_names(model.joints)), plain_names(model.joints)
    sided = [f"{side}_{point}" for side in SIDES]
    rows = [of_model.points_of(name) if of_model else [] for name in names]
    return [row for wanted in sided for row, points in enumerate(rows) if wanted in points]


def _extend(
    weights: NDArray[np.float64], model: Skeleton, toes: Sequence[int]
) -> NDArray[np.float64]:
    """Put a joint that was matched as its parent is beyond it, along the parent's own bone.

    A bone without length has no direction, and neither a hand at the wrist a touch.
    """
    extended = weights.copy()
    for joint in model.order[1:]:
        parent = model.parents[joint]
        above = model.parents[parent]
        is_at_parent = joint not in toes and np.array_equal(weights[joint], weights[parent])
        if above >= 0 and is_at_parent:
            bone = extended[parent] - extended[above]
            extended[joint] = extended[parent] + HAND_REACH * bone
    return extended


def _check_stated(
    capture: Skeleton, model: Skeleton, stated: StatedNames
) -> dict[str, tuple[str, ...]]:
    joints = stated.joints or {}
    for name, parts in joints.items():
        if name not in model.joints:
            raise ValueError(f"the model has no joint {name!r}; it has {_list(model.joints)}")
        for part in parts:
            if part not in capture.joints:
                near = f" (nearest: {_nearest(part, capture) or 'none'})"
                raise ValueError(f"the capture has no joint {part!r}{near}, stated for {name}")
    return joints


def _match(
    capture: Skeleton, model: Skeleton, wanted: Sequence[str], stated: StatedNames
) -> _Match:
    rig = stated.rig
    if not rig and set(wanted) <= set(capture.joints):
        return _Match({joint: (joint,) for joint in wanted})
    plain = _by_plain_name(capture)
    if not rig:
        bare = dict(zip(bare_names(capture.joints), capture.joints, strict=True))
        if set(wanted) <= set(bare):
            return _Match(
                {joint: (bare[joint],) for joint in wanted}, "joints named without their prefix"
            )
    of_model = rig_of_model(plain_names(model.joints))
    if of_model is None:
        return _Match({joint: (joint,) for joint in wanted if joint in capture.joints})
    # Where no rig fits as a whole, one that names what the model needs will do.
    known_by_name = [r for r in RIGS.values() if r.required]
    rigs = [RIGS[rig]] if rig else fitting_rigs(plain) or known_by_name
    matches = {r.name: _by_rig(r, of_model, plain, model, wanted) for r in rigs}
    known = {r.name: (len(matches[r.name].found), len(r.required & set(plain))) for r in rigs}
    best = [name for name in matches if known[name] == max(known.values())]
    match = matches[best[0]]
    same = all(matches[name].found == match.found for name in best)
    if len(match.found) == len(wanted) and not same:
        names = ", ".join(best)
        raise ValueError(
            f"the presets {names} all fit the capture's joints; name one by {stated.option}"
        )
    return match


def _by_rig(
    rig: Rig, of_model: Rig, plain: dict[str, str], model: Skeleton, wanted: Sequence[str]
) -> _Match:
    """Match joints that are the same point of the body."""
    found: dict[str, tuple[str, ...]] = {}
    near, middles = list[str](), list[str]()
    names = dict(zip(model.joints, plain_names(model.joints), strict=True))
    for joint in wanted:
        places = [rig.place_of(point, plain) for point in of_model.points_of(names[joint])]
        place = next((place for place in places if place is not None), None)
        if place is None:
            continue
        found[joint] = tuple(plain[part] for part in place.joints)
        if place.is_near:
            near.append(joint)
        elif len(place.joints) > 1:
            middles.append(f"{joint} = {' + '.join(found[joint])}")
    # A rig after which the file names its joints, mixamorig:Hips, and which names some of them.
    part = [r for r in contained_rigs(rig, plain) if all(j.startswith(r) for j in plain.values())]
    more = f" ({part[0]}'s and more)" if part else ""
    text = f"joints named by the preset {rig.name}{more}"
    if middles:
        text += f"; mid-points: {', '.join(middles)}"
    return _Match(found, text, rig, tuple(near))


def _near_text(match: _Match, beyond: set[str]) -> str:
    """Say where joints are that a rig lacks: beyond one near them, or at it."""
    text = ""
    for where, is_beyond in (
        ("put a third of the last bone beyond it", True),
        ("at the nearest joint", False),
    ):
        joints = [joint for joint in match.near if (joint in beyond) == is_beyond]
        if joints:
            listed = (f"{joint} = {' + '.join(match.found[joint])}" for joint in joints)
            text += f"; {where}: {', '.join(listed)}"
    return text


def _missing_text(
    capture: Skeleton,
    model: Skeleton,
    missing: Sequence[str],
    found: Mapping[str, tuple[str, ...]],
    stated: StatedNames,
) -> str:
    # Of the same name a joint may be another point: the foot of the first Kinect is an ankle.
    owners = {parts: joint for joint, parts in found.items()}
    taken = {parts[0] for parts in owners if len(parts) == 1}
    near = {
        joint: _nearest(joint, capture, taken) or _neighbour(joint, model, found)
        for joint in missing
    }
    listed = [
        f"{joint} (its {near[joint]} is the {owners[(near[joint],)]})"
        if plain_name(near[joint]) == plain_name(joint) and (near[joint],) in owners
        else f"{joint} (nearest: {near[joint] or 'none'})"
        for joint in missing[:_MAX_LISTED]
    ]
    more = f" and {len(missing) - _MAX_LISTED} more" if len(missing) > _MAX_LISTED else ""
    example = next(
        (f"{joint}={name}" for joint, name in near.items() if name), f"{missing[0]}=JOINT"
    )
    return (
        f"the capture names no joint for {len(missing)} of the model's {len(model.joints)} "
        f"({model.name}): {', '.join(listed)}{more}; name them by {stated.option}, "
        f"as in {stated.how.format(example)}"
    )


def _nearest(joint: str, capture: Skeleton, taken: Collection[str] = ()) -> str:
    """Return the joint of the capture whose name is most like another's, of the same side.

    Joints that are taken by another are passed over, unless the name is the same.
    """
    side, wanted = _split_side(plain_name(joint))
    plain = {
        _split_side(name): original
        for name, original in _by_plain_name(capture).items()
        if original not in taken or name == plain_name(joint)
    }
    same = [name for other, name in plain if not side or other == side]
    like = difflib.get_close_matches(wanted, same, n=1, cutoff=_MIN_SIMILARITY)
    if not like:
        return ""
    return plain.get((side, like[0])) or next(o for key, o in plain.items() if key[1] == like[0])


def _split_side(name: str) -> tuple[str, str]:
    side = next((side for side in ("left", "right") if name.startswith(side)), "")
    return side, name.removeprefix(side)


def _by_plain_name(skeleton: Skeleton) -> dict[str, str]:
    return dict(zip(plain_names(skeleton.joints), skeleton.joints, strict=True))


def _neighbour(joint: str, model: Skeleton, found: Mapping[str, tuple[str, ...]]) -> str:
    """Return the joint of the capture for a joint of the model that is next to another."""
    at = model.joints.index(joint)
    beside = [model.parents[at], *(i for i, parent in enumerate(model.parents) if parent == at)]
    names = [found.get(model.joints[i], ()) for i in beside if i >= 0]
    return next((name[0] for name in names if len(name) == 1), "")


def _list(names: Sequence[str]) -> str:
    return ", ".join(names[:40])
