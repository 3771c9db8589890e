"""What one person chooses alone: the private variables, whence the variety of reactions."""

from dataclasses import dataclass

import numpy as np

from pacmo_core.synthesis.body import Subject
from pacmo_core.synthesis.curves import Array
from pacmo_core.synthesis.gait import Gait

CHANNELS = 11  # of sway: seven of the trunk, two of each arm
HARMONICS = 3


@dataclass(frozen=True)
class Choices:
    """The private variables of one person in one clip.

    Parameters
    ----------
    delay : seconds from the cue to the response
    strength : of the response or of the flourish, about 1
    side : 1 left, -1 right: to which side one dodges, turns or leans
    manner : 0, 1, 2: which of an act's ways
    idle : 0 to 3: what the free hand does
    early : seconds that a reach or an arrival comes before it must, or a return after it may
    more : eight numbers between 0 and 1 for an act's own use
    gait : how this person steps
    phases, rates : of the sway, radians and hertz
    """

    delay: float
    strength: float
    side: float
    manner: int
    idle: int
    early: float
    more: tuple[float, ...]
    gait: Gait
    phases: Array
    rates: Array


def choose(random: np.random.Generator, person: Subject) -> Choices:
    """Draw one person's private variables; the person's habits set what is usual."""
    return Choices(
        delay=float(np.exp(random.normal(np.log(0.20), 0.4)).clip(0.07, 0.5)),
        strength=float(np.exp(random.normal(0.0, 0.28)).clip(0.5, 1.8)),
        side=1.0 if random.random() < 0.5 - 0.15 * person.handedness else -1.0,
        manner=int(random.choice(3, p=[0.45, 0.35, 0.2])),
        idle=int(random.choice(4, p=[0.5, 0.2, 0.15, 0.15])),
        early=float(random.uniform(0.0, 0.25)),
        more=tuple(random.random(8).tolist()),
        gait=_gait(random, person),
        phases=random.uniform(0.0, 2.0 * np.pi, (CHANNELS, HARMONICS)),
        rates=random.uniform(0.12, 0.7, (CHANNELS, HARMONICS)),
    )


def _gait(random: np.random.Generator, person: Subject) -> Gait:
    return Gait(
        step_time=float(random.normal(0.52, 0.03)) / person.tempo,
        phase=float(random.random()),
        first=int(random.random() < 0.5),
        stance=person.stance + float(random.uniform(-0.015, 0.015)),
        stagger=float(random.normal(0.0, 0.035)),
        toe_out=float(random.normal(0.15, 0.05)),
        lead=person.body.foot_forward - 0.01 + float(random.normal(0.0, 0.008)),
        clearance=float(random.uniform(0.05, 0.085)),
    )
