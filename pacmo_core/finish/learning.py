"""What a finish learns from generated reactions to held-out partners and the captured ones."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.interaction import Interaction, Motion
from pacmo_core.data.segments import feet
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.finish.avoidance import trunk_offset
from pacmo_core.finish.bones import median_lengths
from pacmo_core.finish.contacts import find_pairs, learn_contacts
from pacmo_core.finish.finish import calmed
from pacmo_core.finish.floor import (
    MIN_ALOFT,
    find_aloft,
    floor_errors,
    learn_floor_tolerance,
    set_down,
)
from pacmo_core.finish.heights import learn_heights, pelvis_heights
from pacmo_core.finish.learnt import Learnt, nothing_learnt
from pacmo_core.finish.travel import peak_speeds
from pacmo_core.finish.trunk import learn_trunk
from pacmo_core.finish.turns import resolve_turns
from pacmo_core.finish.twitches import peak_accelerations

Example = tuple[Interaction, Motion]
Clip = TypeVar("Clip")  # or a clip with its label
# Validation clips; with fewer the finish is fitted to training clips too.
MIN_FITTED_CLIPS = 20


def fitted_on(validation: Sequence[Clip], training: Sequence[Clip]) -> list[Clip]:
    """Choose the clips that a finish is fitted to: those of validation, if they suffice.

    Reactions to training partners are nearer to the captured ones than those to others, and would
    teach that a hand that stops short has not arrived. So training clips are taken only beside
    fewer than ``MIN_FITTED_CLIPS`` others: a finish that is fitted to the eight or nine validation
    clips of a fold of SBU costs contacts (docs/results_recorded.md, *Fine-tuned*).
    """
    return [*validation, *(training if len(validation) < MIN_FITTED_CLIPS else [])]


def learn(examples: Sequence[Example], skeleton: Skeleton) -> Learnt:
    """Learn in the order in which a finish applies it: the body, contacts, floors, heights.

    Parameters
    ----------
    examples : captured interactions, of which ``person_b`` reacted, and a generated reaction to
        each ``person_a``, (T, J, 3) float32 metres
    skeleton : of all
    """
    if not examples:
        return nothing_learnt(skeleton)
    rates = [float(1 / np.median(np.diff(clip.times))) for clip, _ in examples]
    learnt = _of_bodies(examples, rates, skeleton)
    calm = [
        calmed(reaction, clip.person_a, fps, skeleton, learnt).astype(np.float32)
        for (clip, reaction), fps in zip(examples, rates, strict=True)
    ]
    learnt = replace(learnt, contacts=_contacts(calm, examples, rates, skeleton))
    return _of_floors(calm, examples, rates, learnt, skeleton) if feet(skeleton) else learnt


def _of_bodies(examples: Sequence[Example], rates: Sequence[float], skeleton: Skeleton) -> Learnt:
    """Learn the shape of trunks, and what captured bodies do at most and at least."""
    generated, captured, speeds, accelerations, distances = [], [], [], [], []
    for (clip, reaction), fps in zip(examples, rates, strict=True):
        real = clip.person_b.astype(np.float64)
        generated.append(resolve_turns(reaction.astype(np.float64), fps, skeleton))
        captured.append(real)
        speeds.append(peak_speeds(real, fps, skeleton))
        accelerations.append(peak_accelerations(real, fps))
        distances.append(np.linalg.norm(trunk_offset(real, clip.person_a, skeleton), axis=1).min())
    return replace(
        nothing_learnt(skeleton),
        trunk=learn_trunk(zip(generated, captured, strict=True), skeleton),
        max_speeds=np.max(speeds, axis=0),
        max_accelerations=np.max(accelerations, axis=0),
        least_distance=np.array(min(distances)),
    )


def _contacts(
    calm: Sequence[Motion], examples: Sequence[Example], rates: Sequence[float], skeleton: Skeleton
) -> NDArray[np.float64]:
    pairs = []
    for body, (clip, _), fps in zip(calm, examples, rates, strict=True):
        generated, real = (
            find_pairs(person, clip.person_a, fps, skeleton) for person in (body, clip.person_b)
        )
        pairs.append((generated, real))
    return learn_contacts(pairs, skeleton)


def _of_floors(
    calm: Sequence[Motion],
    examples: Sequence[Example],
    rates: Sequence[float],
    learnt: Learnt,
    skeleton: Skeleton,
) -> Learnt:
    """Learn whether the two share a floor and leave it, and the heights of who stands."""
    errors, in_air, heights = [], [], []
    for body, (clip, _), fps in zip(calm, examples, rates, strict=True):
        errors.append(floor_errors(body, clip.person_b, clip.person_a, fps, skeleton))
        in_air.append(find_aloft(clip.person_b, fps, skeleton))
    tolerance = learn_floor_tolerance(np.array(errors))
    leaves_floor = bool(np.concatenate(in_air).mean() > MIN_ALOFT)
    for body, (clip, _), fps in zip(calm, examples, rates, strict=True):
        aloft = find_aloft(body, fps, skeleton) & leaves_floor
        down = set_down(body.astype(np.float64), clip.person_a, fps, skeleton, tolerance, aloft)
        heights.append((_heights(down, skeleton), _heights(clip.person_b, skeleton)))
    return replace(
        learnt,
        heights=learn_heights(heights),
        floor_tolerance=np.array(tolerance),
        leaves_floor=np.array(float(leaves_floor)),
    )


def _heights(motion: Motion | NDArray[np.float64], skeleton: Skeleton) -> NDArray[np.float64]:
    lengths = median_lengths(motion.astype(np.float32), skeleton)
    return pelvis_heights(motion.astype(np.float64), lengths, skeleton)
