"""What an act asks of one person's body: the vocabulary between choreography and bones.

All places are in the person's own frame on the stage: the two people's meeting plane is z = 0, this
person stands behind it at negative z and looks along +z; x is to the left, y is up.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pacmo_core.synthesis.curves import Array
from pacmo_core.synthesis.gait import Path

LEFT, RIGHT = 0, 1
Course = Callable[[Array], Array]  # (T,) seconds to (T, 3) metres


@dataclass(frozen=True)
class Spell:
    """When something comes and goes: seconds at which it starts, is full, fades and is gone."""

    start: float
    arrive: float
    leave: float
    back: float


@dataclass(frozen=True)
class Reach:
    """A hand's palm follows a course for a spell; before and after it hangs or swings.

    Parameters
    ----------
    hand : LEFT or RIGHT
    spell : when
    course : places over time, on the stage or, if ``on_chest``, relative to the upper spine
    on_chest : whether the course moves along with the chest
    flare : 0 elbow down and back, 1 elbow out to the side
    detour : metres by which the way there and back is bent, (x, y, z)
    """

    hand: int
    spell: Spell
    course: Course
    on_chest: bool = False
    flare: float = 0.2
    detour: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Lean:
    """The trunk bends for a spell: radians and metres, as ``kinematics`` counts them.

    Parameters
    ----------
    spell : when
    pitch, roll, twist : of the trunk; twist turns the shoulders to the left
    nod : of the head beyond the trunk's pitch
    crouch, aside, ahead : the pelvis goes down, to the left, forward
    """

    spell: Spell
    pitch: float = 0.0
    roll: float = 0.0
    twist: float = 0.0
    nod: float = 0.0
    crouch: float = 0.0
    aside: float = 0.0
    ahead: float = 0.0


@dataclass(frozen=True)
class Kick:
    """A foot is lifted, thrust at a place in the air, drawn back and put down.

    Parameters
    ----------
    foot : LEFT or RIGHT
    point : where its ankle is thrust, on the stage
    chamber : when the knee is up
    thrust : when the leg is out; within ``chamber``
    """

    foot: int
    point: tuple[float, float, float]
    chamber: Spell
    thrust: Spell


@dataclass(frozen=True)
class Part:
    """One person's part in a clip.

    Parameters
    ----------
    path : where the pelvis goes
    hurry : this person steps so many times faster than usual
    reaches : what the hands do; where two overlap, the later in the tuple rules
    leans : what the trunk does; those that overlap add up
    kick : what a foot does beside walking
    """

    path: Path
    hurry: float = 1.0
    reaches: tuple[Reach, ...] = ()
    leans: tuple[Lean, ...] = ()
    kick: Kick | None = None


def fixed(x: float, y: float, z: float) -> Course:
    """Stay at one place."""
    return lambda times: np.tile([x, y, z], (len(times), 1))
