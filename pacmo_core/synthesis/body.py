"""Subjects: bone lengths and habits of a population, and the private variables of a clip.

Stature: ANSUR II (Gordon et al. 2014, 2012 Anthropometric Survey of U.S. Army Personnel).
Segments as fractions of stature: Drillis and Contini (1966), Body segment parameters, as tabled by
Winter (2009), fig. 4.1. Where a depth camera places a joint off the end of a bone, the fraction
is that of Kinect.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from pacmo_core.synthesis.gait import Gait
from pacmo_core.synthesis.kinematics import Array

# Metres: mean and standard deviation.
STATURE = {"female": (1.6285, 0.0642), "male": (1.7562, 0.0686)}

# Fractions of stature: limbs by Winter's table; trunk joints, palm and foot as in Kinect.
SHARES = {
    "thigh": 0.245,
    "shank": 0.246,
    "ankle_height": 0.039,
    "foot_forward": 0.065,
    "foot_height": 0.010,
    "hip_half": 0.046,
    "hip_drop": 0.012,
    "lower_spine": 0.148,
    "upper_spine": 0.110,
    "neck": 0.040,
    "head": 0.070,
    "shoulder_half": 0.096,
    "shoulder_drop": 0.018,
    "upper_arm": 0.186,
    "forearm": 0.146,
    "palm": 0.035,
    "finger": 0.045,
    "thumb": 0.030,
}
SEGMENT_SPREAD = 0.025  # relative standard deviation of a segment; segments vary independently


@dataclass(frozen=True)
class SyntheticBody:
    """Lengths of one body, metres; left and right are equal."""

    stature: float
    thigh: float
    shank: float
    ankle_height: float
    foot_forward: float
    foot_height: float
    hip_half: float
    hip_drop: float
    lower_spine: float
    upper_spine: float
    neck: float
    head: float
    shoulder_half: float
    shoulder_drop: float
    upper_arm: float
    forearm: float
    palm: float
    finger: float
    thumb: float

    @property
    def leg(self) -> float:
        """Distance from hip to ankle of a straight leg."""
        return self.thigh + self.shank

    @property
    def arm(self) -> float:
        """Distance from shoulder to palm of a straight arm."""
        return self.upper_arm + self.forearm + self.palm

    @property
    def base_height(self) -> float:
        """Height of the base of the spine when standing upright."""
        return self.hip_drop + self.leg + self.ankle_height

    @property
    def shoulder_height(self) -> float:
        """Height of the shoulders when standing upright."""
        return self.base_height + self.lower_spine + self.upper_spine - self.shoulder_drop

    @property
    def head_height(self) -> float:
        """Height of the centre of the head when standing upright."""
        return self.base_height + self.lower_spine + self.upper_spine + self.neck + self.head


@dataclass(frozen=True)
class Subject:
    """A person: a body and habits, the same in all clips of this person.

    Parameters
    ----------
    number : 1 and up
    sex : female or male
    body : lengths
    handedness : 1 left, -1 right: the preferred hand and foot
    tempo : habitual pace relative to the mean, about 1
    stoop : radians by which the trunk leans forward at rest
    swing : amplitude of arm swing relative to the mean, about 1
    stance : half the distance between the feet at rest, metres
    """

    number: int
    sex: str
    body: SyntheticBody
    handedness: int
    tempo: float
    stoop: float
    swing: float
    stance: float


@lru_cache(maxsize=4096)
def sample_subject(population: int, number: int) -> Subject:
    """Sample subject ``number`` of a population from its own generator.

    Raises
    ------
    ValueError
        If ``population`` is negative or ``number`` is not positive.
    """
    if population < 0 or number < 1:
        raise ValueError(
            f"wanted population >= 0 and subject number >= 1; got {population}, {number}"
        )
    random = np.random.default_rng([population, number])
    sex = "female" if random.random() < 0.5 else "male"
    stature = random.normal(*STATURE[sex])
    spread = random.normal(1.0, SEGMENT_SPREAD, len(SHARES)).clip(0.92, 1.08)
    lengths = {name: stature * SHARES[name] * k for name, k in zip(SHARES, spread, strict=True)}
    return Subject(
        number=number,
        sex=sex,
        body=SyntheticBody(stature=stature, **lengths),
        handedness=1 if random.random() < 0.1 else -1,
        tempo=float(np.exp(random.normal(0.0, 0.08))),
        stoop=float(random.normal(0.04, 0.025)),
        swing=float(np.exp(random.normal(0.0, 0.25))),
        stance=float(random.uniform(0.07, 0.13)),
    )


def sample_pair(population: int, pair: int) -> tuple[Subject, Subject]:
    """Return both people of a pair: subjects ``2 pair - 1`` and ``2 pair``."""
    return sample_subject(population, 2 * pair - 1), sample_subject(population, 2 * pair)


N_SWAY_CHANNELS = 11  # seven of the trunk, two of each arm
N_HARMONICS = 3


@dataclass(frozen=True)
class PrivateVariables:
    """The private variables of one person in one clip: the source of variation of reactions.

    Parameters
    ----------
    delay : seconds from the event to the response
    strength : of the response or of the flourish, about 1
    side : 1 left, -1 right: the side to which the person dodges, turns or leans
    manner : 0, 1, 2: variant of the action
    idle : 0 to 3: position of the free hand
    early : seconds by which a reach or an arrival is early, or a return is late
    heading, facing : radians to the left of the straight line to the meeting plane: of the way in,
        and of the pelvis at the event
    leaves : whether the person walks off after a greeting or a strike
    more : eight numbers between 0 and 1, used by the actions
    gait : of this person in this clip
    phases, rates : of the sway, radians and hertz
    """

    delay: float
    strength: float
    side: float
    manner: int
    idle: int
    early: float
    heading: float
    facing: float
    leaves: bool
    more: tuple[float, ...]
    gait: Gait
    phases: Array
    rates: Array


def sample_private_variables(random: np.random.Generator, person: Subject) -> PrivateVariables:
    """Sample one person's private variables; the person's habits set the means."""
    return PrivateVariables(
        delay=float(np.exp(random.normal(np.log(0.20), 0.4)).clip(0.07, 0.5)),
        strength=float(np.exp(random.normal(0.0, 0.28)).clip(0.5, 1.8)),
        side=1.0 if random.random() < 0.5 - 0.15 * person.handedness else -1.0,
        manner=int(random.choice(3, p=[0.45, 0.35, 0.2])),
        idle=int(random.choice(4, p=[0.5, 0.2, 0.15, 0.15])),
        early=float(random.uniform(0.0, 0.25)),
        heading=float(np.clip(random.normal(0.0, 0.3), -0.7, 0.7)),
        facing=float(np.clip(random.normal(0.0, 0.14), -0.4, 0.4)),
        leaves=bool(random.random() < 0.3),
        more=tuple(random.random(8).tolist()),
        gait=_sample_gait(random, person),
        phases=random.uniform(0.0, 2.0 * np.pi, (N_SWAY_CHANNELS, N_HARMONICS)),
        rates=random.uniform(0.12, 0.7, (N_SWAY_CHANNELS, N_HARMONICS)),
    )


def _sample_gait(random: np.random.Generator, person: Subject) -> Gait:
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
