"""Unit and upward axis of a capture: inferred where nothing states them, checked where it does.

The unit follows from the stature of the people, the axis from the direction of their trunks over
the clip (``data.posture``). Both need a skeleton with two arms and two legs.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.interaction import Motion
from pacmo_core.data.posture import (
    CMU_UNIT,
    MAX_STATURE,
    MIN_STATURE,
    UNITS,
    Posture,
    infer_unit,
    infer_up,
    lying_fault,
    measure_posture,
    missing_limbs,
    stand_along_another_axis,
)
from pacmo_core.data.skeleton import Skeleton, mirror_by_name
from pacmo_core.formats.base import Format
from pacmo_core.formats.bvh import read_bvh
from pacmo_core.formats.bvh_pairs import unstated_settings
from pacmo_core.formats.joint_names import UNSTATED, StatedNames, stated_body
from pacmo_core.formats.resample import from_y_up
from pacmo_core.formats.rigs import fitting_rigs, plain_names
from pacmo_core.formats.scene_nodes import SceneNodes
from pacmo_core.formats.table import Table

UNIT_NAMES = {value: name for name, value in UNITS.items()} | {CMU_UNIT: "CMU's unit"}
_FACTS = ("unit", "up")
OTHER_AXIS = "was taken for up, but"  # in the reason for which a capture on its side is refused
MIN_USUAL_STATURE = 0.9  # metres, of people who move as pairs do; smaller ones are in another unit


@dataclass(frozen=True)
class Inferred:
    """What was inferred of one file.

    Parameters
    ----------
    settings : ``unit`` and ``up``, of those that nothing states; None where the motion does not
        show it
    stature : metres, of the tallest person; None where no body was recognised
    missing : the limbs for want of which none was
    """

    settings: dict[str, Any]
    stature: float | None
    missing: tuple[str, ...] = ()


def infer_settings(
    file: Path, format_name: str, settings: Mapping[str, Any], names: StatedNames = UNSTATED
) -> Inferred:
    """Infer the unit and the upward axis of a file of a format that may lack them.

    Parameters
    ----------
    file : a capture
    format_name : of its format; the files of others than bvh and table state both
    settings : that are given
    names : of the joints, if the user states them

    Raises
    ------
    FormatError
        If the file is broken.
    """
    if format_name == "bvh":
        unstated = unstated_settings(settings.get("preset", "pair"), settings)
        return _infer(unstated, *_bvh_people(file), names) if unstated else Inferred({}, None)
    if format_name == "table":
        stated = {name: settings[name] for name in _FACTS if name in settings}
        table = Table(**stated).read_undescribed(file)
        return _infer(table.unstated, table.skeleton, table.people, names)
    return Inferred({}, None)


def _bvh_people(file: Path) -> tuple[Skeleton, list[NDArray[np.float64]]]:
    bvh = read_bvh(file)
    body = SceneNodes.of(bvh).body()
    skeleton = Skeleton("bvh", body.joints, body.parents, mirror_by_name(body.joints))
    person = skeleton.without(body.joints[end] for end in body.end_sites)
    rows = [bvh.joints.index(joint) for joint in person.joints]
    return person, [bvh.positions()[:, rows]]


def _infer(
    unstated: Sequence[str],
    skeleton: Skeleton,
    people: Sequence[NDArray[np.float64]],
    names: StatedNames,
) -> Inferred:
    if not unstated:
        return Inferred({}, None)
    bodies = [stated_body(skeleton, motion, names) for motion in people]
    measured = [measure_posture(motion, body) for body, motion in bodies]
    postures = [posture for posture in measured if posture is not None]
    if not postures:
        missing = tuple(missing_limbs(bodies[0][0])) if bodies else ()
        return Inferred(dict.fromkeys(unstated), None, missing)
    of_cmu = any(rig.name.startswith("cmu") for rig in fitting_rigs(plain_names(skeleton.joints)))
    tallest = max(postures, key=lambda posture: posture.stature)
    unit = infer_unit(tallest, of_cmu=of_cmu)
    if unit is None or unit * tallest.stature < MIN_USUAL_STATURE:
        # As files of other joints that stand beside one of CMU, such as a rig.
        unit = infer_unit(tallest, of_cmu=True)
    axes = {axis for axis in map(infer_up, postures) if axis}
    known = {"unit": unit, "up": axes.pop() if len(axes) == 1 else None}
    stature = None if unit is None else unit * tallest.stature
    return Inferred({name: known[name] for name in unstated}, stature)


def states_unit_or_axis(form: Format | type[Any]) -> bool:
    """Whether files of a format are read by a unit or an upward axis that someone states."""
    return any(field.name in _FACTS for field in fields(form))  # type: ignore[arg-type]


def implausible(
    people: Sequence[tuple[Skeleton, Motion]], stated: Sequence[str | None]
) -> tuple[int, str] | None:
    """Find a person whose stature or posture no unit and axis that are right would give.

    A posture is a fault only if no other person is upright: someone may be carried.

    Parameters
    ----------
    people : of one world, metres, y up
    stated : the upward axis of the file of each, ``y`` or ``z``, by which it was read; None if the
        file itself states it

    Returns
    -------
    The number of the person and the reason; None if nobody is implausible.
    """
    postures = [measure_posture(motion, skeleton) for skeleton, motion in people]
    known = [(number, posture) for number, posture in enumerate(postures) if posture is not None]
    for number, posture in known:
        if not MIN_STATURE <= posture.stature <= MAX_STATURE:
            return number, _stature_text(posture)
    faults = [(number, fault) for number, posture in known if (fault := lying_fault(posture))]
    if len(known) > 1 and stand_along_another_axis([posture for _, posture in known]):
        faults = [(number, "lying while standing") for number, _ in known]
    if not faults or len(faults) < len(known):
        return None
    number, fault = faults[0]
    up, trunk = stated[number], dict(known)[number].trunk.astype(np.float32)
    if up is None:
        return number, f"a person {fault} with the upward axis that the file states"
    found = _main_axis(trunk if up == "y" else from_y_up(trunk, up))
    return number, f"{up} {OTHER_AXIS} the trunk of a person is along {found} throughout"


def _main_axis(vectors: Motion) -> str:
    """Name the axis that vectors (T, 3) are nearest to: ``z``, or ``−z``."""
    mean = vectors.mean(axis=0)
    axis = int(np.abs(mean).argmax())
    return f"{'−' if mean[axis] < 0 else ''}{'xyz'[axis]}"


def _stature_text(posture: Posture) -> str:
    text = f"a person of {posture.stature:.3g} m: wanted {MIN_STATURE:g} to {MAX_STATURE:g} m"
    factor = infer_unit(posture)
    if factor in (None, 1.0):
        return f"{text}; wanted another unit"
    return f"{text}; {factor:g} times the unit would give {factor * posture.stature:.2f} m"
