"""Acts of force: push, kick, punch. How they are taken stands in ``recoils``."""

import numpy as np

from pacmo_core.synthesis.curves import Array, ramp
from pacmo_core.synthesis.direct import Cue, Move, enter, leave, route
from pacmo_core.synthesis.part import Course, Kick, Lean, Part, Reach, Spell, fixed
from pacmo_core.synthesis.recoils import kicked, pushed, struck
from pacmo_core.synthesis.staging import CHEST


def push(cue: Cue) -> Part:
    """Push the partner's chest with both hands, or be pushed."""
    return _push(cue) if cue.first else pushed(cue)


def kick(cue: Cue) -> Part:
    """Kick the partner's thigh or belly, or be kicked."""
    return _kick(cue) if cue.first else kicked(cue)


def punch(cue: Cue) -> Part:
    """Strike at the partner's face, or be struck."""
    return _punch(cue) if cue.first else struck(cue)


def _step_in(cue: Cue, way: float) -> tuple[Move, ...]:
    """Come to one's place with a last step into the blow, and perhaps fall back from it."""
    return (enter(cue, cue.event + 0.02, way), *leave(cue, cue.event + 0.3))


def _push(cue: Cue) -> Part:
    own = cue.own
    ready, back = cue.event - 0.5 - own.early, cue.over + 0.1 + 0.2 * own.more[4]
    reaches = []
    for hand, sign in ((0, 1.0), (1, -1.0)):
        chamber = fixed(sign * 0.15, -0.13, 0.17 - 0.03 * own.strength)
        reaches.append(
            Reach(
                hand, Spell(ready - 0.2, ready + 0.15, cue.event - 0.02, back), chamber, True, 0.4
            )
        )
        place = (cue.aside + sign * 0.11, cue.script.level, cue.partner - CHEST - 0.03)
        thrust = Spell(cue.event - 0.28, cue.event, back, back + 0.5)
        reaches.append(Reach(hand, thrust, _through(cue, place), False, 0.35))
    lean = Lean(Spell(cue.event - 0.25, cue.event + 0.12, back, back + 0.6), pitch=0.16, ahead=0.05)
    way = 0.12 + 0.12 * own.more[5]
    path = route(0.0, -cue.stand - cue.entry - way, *_step_in(cue, way))
    return Part(path, hurry=1.2, reaches=tuple(reaches), leans=(lean,))


def _through(cue: Cue, place: tuple[float, float, float]) -> Course:
    """Reach a place at the event and go on a little."""

    def course(times: Array) -> Array:
        on = ramp(times, cue.event - 0.05, cue.event + 0.2)
        gone: Array = np.array(place) + np.outer(on, [0.0, 0.0, 0.07 * cue.script.vigour])
        return gone

    return course


def _kick(cue: Cue) -> Part:
    own, body, foot = cue.own, cue.me.body, cue.hand
    sign = 1.0 - 2.0 * foot
    event, gone = cue.event, cue.over
    point = (cue.aside + 0.05 * sign, cue.script.level, cue.partner - CHEST - 0.10)
    leg = Kick(
        foot,
        point,
        Spell(event - 0.52, event - 0.16, gone + 0.15, gone + 0.6),
        Spell(event - 0.26, event, gone, gone + 0.34),
    )
    lean = Lean(
        Spell(event - 0.5, event - 0.05, gone + 0.1, gone + 0.6),
        pitch=-0.16 - 0.08 * own.strength,
        twist=0.25 * sign,
        aside=-sign * 0.075,
        ahead=0.06,
        roll=0.05 * sign,
    )
    arms = Spell(event - 0.45, event - 0.05, gone + 0.1, gone + 0.7)
    size = body.stature
    guard = (fixed(-sign * 0.13, -0.10, 0.24), fixed(-sign * 0.24 * size, -0.10 * size, 0.06))[
        own.manner > 0
    ]
    counter = fixed(sign * 0.20 * size, -0.17 * size, 0.02)
    reaches = (
        Reach(1 - foot, arms, guard, True, 0.5),
        Reach(foot, arms, counter, True, 0.7),
    )
    walk = enter(cue, event - 0.45)
    path = route(0.0, -cue.stand - walk.z, walk, *leave(cue, gone + 0.45))
    return Part(path, reaches=reaches, leans=(lean,), kick=leg)


def _punch(cue: Cue) -> Part:
    own, hand = cue.own, cue.hand
    sign, event = 1.0 - 2.0 * cue.hand, cue.event
    ready = event - 0.55 - own.early
    back = cue.over + 0.04
    cocked = fixed(sign * 0.21, -0.20, 0.16 - 0.04 * own.strength)
    place = fixed(cue.aside, cue.script.level, cue.partner - 0.17)
    reaches = (
        Reach(hand, Spell(ready, ready + 0.35, event - 0.02, back), cocked, True, 0.6),
        Reach(hand, Spell(event - 0.22, event, back, back + 0.45), place, False, 0.55),
        Reach(
            1 - hand,
            Spell(ready, ready + 0.4, event + 0.3, event + 0.9),
            fixed(-sign * 0.13, -0.06, 0.24),
            True,
        ),
    )
    leans = (
        Lean(Spell(ready, ready + 0.35, ready + 0.36, event), twist=0.35 * sign * own.strength),
        Lean(
            Spell(event - 0.25, event, back, back + 0.6), twist=-0.5 * sign, pitch=0.12, ahead=0.06
        ),
    )
    way = 0.10 + 0.15 * own.more[5]
    path = route(0.0, -cue.stand - cue.entry - way, *_step_in(cue, way))
    return Part(path, hurry=1.2, reaches=reaches, leans=leans)
