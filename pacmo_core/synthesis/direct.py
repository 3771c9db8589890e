"""What acts are made of: one person's view of the script, routes, entries, free hands."""

from dataclasses import dataclass

import numpy as np

from pacmo_core.synthesis.body import Subject
from pacmo_core.synthesis.choices import Choices
from pacmo_core.synthesis.curves import Array, bump, glide, window
from pacmo_core.synthesis.gait import Path
from pacmo_core.synthesis.part import Course, Reach, Spell, fixed
from pacmo_core.synthesis.script import Role, Script

ALWAYS = Spell(-9.0, -8.0, 90.0, 91.0)


@dataclass(frozen=True)
class Cue:
    """The script as one person reads it: who I am, what I chose, where my partner will be."""

    script: Script
    role: Role
    me: Subject
    you: Subject
    own: Choices

    @property
    def first(self) -> bool:
        """Whether I am the one who acts."""
        return self.role == self.script.initiator

    @property
    def stand(self) -> float:
        """Metres from me to the meeting plane."""
        return self.script.stand["ab".index(self.role)]

    @property
    def partner(self) -> float:
        """The partner's place along my z."""
        return self.script.stand[1 - "ab".index(self.role)]

    @property
    def entry(self) -> float:
        """How far I come or go."""
        return self.script.entry["ab".index(self.role)]

    @property
    def hand(self) -> int:
        """The hand I use."""
        return self.script.hands["ab".index(self.role)]

    @property
    def aside(self) -> float:
        """The contact's place along my x."""
        return self.script.aside * (1.0 if self.role == "a" else -1.0)

    @property
    def event(self) -> float:
        """When the act comes to its point."""
        return self.script.event

    @property
    def over(self) -> float:
        """When the contact ends."""
        return self.script.event + self.script.hold

    @property
    def response(self) -> float:
        """When I respond to a blow."""
        return self.script.event + 0.5 * self.own.delay


@dataclass(frozen=True)
class Move:
    """A shift of the pelvis along x and z and a turn, between two times."""

    start: float
    stop: float
    x: float = 0.0
    z: float = 0.0
    yaw: float = 0.0
    ease: float = 0.45
    bow: float = 0.0


def route(x: float, z: float, *moves: Move) -> Path:
    """Begin at (x, z) facing the partner and make every move; its ``bow`` bends it half way."""

    def path(times: Array) -> Array:
        place = np.tile([x, z, 0.0], (len(times), 1))
        for move in moves:
            part = glide(times, move.start, move.stop, move.ease)
            place = place + part[:, None] * [move.x, move.z, move.yaw]
            place[:, 0] += move.bow * bump(part)
        return place

    return path


def enter(cue: Cue, arrive: float, extra: float = 0.0) -> Move:
    """Walk in to one's place, there by ``arrive``."""
    way = cue.entry + extra
    time = 0.5 + way / (1.0 * cue.me.tempo * (0.9 + 0.25 * cue.own.more[0]))
    return Move(arrive - time, arrive, z=way, bow=cue.own.side * 0.05 * cue.own.more[1])


def leave(cue: Cue, start: float, *, always: bool = False) -> tuple[Move, ...]:
    """Step back after the act; unless ``always``, only if the script says so."""
    if cue.script.stays and not always:
        return ()
    way = 0.2 + 0.35 * cue.own.more[2]
    begin = start + 0.1 + cue.own.delay
    return (Move(begin, begin + 0.55 + way / 0.9, z=-way, yaw=0.35 * cue.own.side),)


def free_hand(cue: Cue, hand: int) -> tuple[Reach, ...]:
    """Let a hand that has no task hang, or rest on the hip, behind the back or before the belly."""
    sign = 1.0 - 2.0 * hand
    size = cue.me.body.stature
    place = (
        None,
        (0.118 * size, -0.245 * size, -0.02, 0.95),
        (0.03 * size, -0.245 * size, -0.15, 0.55),
        (0.03 * size, -0.200 * size, 0.19, 0.25),
    )[cue.own.idle]
    if place is None:
        return ()
    x, y, z, flare = place
    begin = cue.event + 0.4 if cue.own.more[3] < 0.25 else -2.0
    spell = Spell(begin, begin + 0.6, 90.0, 91.0)
    bend = (sign * (0.16 if z < 0 else 0.06), 0.0, 0.0)
    return (Reach(hand, spell, fixed(sign * x, y, z), True, flare, bend),)


def contact(cue: Cue, give: float = 0.0) -> tuple[float, float, float]:
    """Where the contact is, ``give`` metres on my side of the meeting plane."""
    return cue.aside, cue.script.level, -give


def shaken(cue: Cue, place: tuple[float, float, float]) -> Course:
    """Keep to a place, and go up and down with the script's beat while the contact lasts."""

    def course(times: Array) -> Array:
        still = window(times, cue.event - 0.05, cue.event + 0.2, cue.over - 0.15, cue.over + 0.1)
        wave = np.sin(2.0 * np.pi * cue.script.beat * (times - cue.event)) * still
        place_then: Array = np.array(place) + np.outer(wave, [0.0, 0.03 * cue.script.vigour, 0.0])
        return place_then

    return course
