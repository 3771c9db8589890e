"""Acts of force: push, kick, punch; and the ways in which they are taken."""

from pacmo_core.synthesis.curves import Array, ramp
from pacmo_core.synthesis.direct import Cue, Move, enter, free_hand, leave, route
from pacmo_core.synthesis.part import Course, Kick, Lean, Part, Reach, Spell, fixed
from pacmo_core.synthesis.staging import CHEST

import numpy as np


def push(cue: Cue) -> Part:
    """Push the partner's chest with both hands, or be pushed."""
    return _push(cue) if cue.first else _pushed(cue)


def kick(cue: Cue) -> Part:
    """Kick the partner's thigh or belly, or be kicked."""
    return _kick(cue) if cue.first else _kicked(cue)


def punch(cue: Cue) -> Part:
    """Strike at the partner's face, or be struck."""
    return _punch(cue) if cue.first else _struck(cue)


def _step_in(cue: Cue, way: float) -> tuple[Move, ...]:
    """Come to one's place with a last step into the blow, and perhaps fall back from it."""
    return (enter(cue, cue.event + 0.02, way), *leave(cue, cue.event + 0.3))


def _push(cue: Cue) -> Part:
    own = cue.own
    ready, back = cue.event - 0.5 - own.early, cue.over + 0.1 + 0.2 * own.more[4]
    reaches = []
    for hand, sign in ((0, 1.0), (1, -1.0)):
        chamber = fixed(sign * 0.15, -0.13, 0.17 - 0.03 * own.strength)
        reaches.append(Reach(hand, Spell(ready - 0.2, ready + 0.15, cue.event - 0.02, back), chamber, True, 0.4))
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
        return np.array(place) + np.outer(on, [0.0, 0.0, 0.07 * cue.script.vigour])

    return course


def _pushed(cue: Cue) -> Part:
    own, begin = cue.own, cue.response
    force = float(np.clip(cue.script.vigour * own.strength, 0.45, 1.9))
    way = (0.42, 0.36, 0.12)[own.manner] * force
    yaw = (0.0, 0.7 * own.side, 0.0)[own.manner]
    aside = (0.0, 0.12 * own.side, 0.0)[own.manner]
    fall = Move(begin - 0.02, begin + 0.55 + 0.35 * way, aside, -way, yaw, ease=0.3)
    jolt = Spell(begin, begin + 0.18, begin + 0.28, begin + 0.85)
    lean = Lean(jolt, pitch=-0.20 * force, nod=0.15 * force, crouch=0.03 if own.manner < 2 else 0.08)
    twist = Lean(jolt, twist=(0.0, 0.35 * own.side, 0.0)[own.manner])
    walk = enter(cue, cue.event - 0.35 - own.early)
    path = route(0.0, -cue.stand - walk.z, walk, fall)
    fling = Spell(begin, begin + 0.25, begin + 0.4, begin + 1.0)
    reaches = tuple(
        Reach(hand, fling, fixed(sign * 0.36, -0.12 - 0.1 * own.more[5], 0.20), True, 0.6)
        for hand, sign in ((0, 1.0), (1, -1.0))
        if own.more[6] < 0.75 or hand == int(own.side < 0)
    )
    return Part(path, hurry=1.45, reaches=reaches, leans=(lean, twist))


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
    guard = (fixed(-sign * 0.13, -0.10, 0.24), fixed(-sign * 0.24 * size, -0.10 * size, 0.06))[own.manner > 0]
    counter = fixed(sign * 0.20 * size, -0.17 * size, 0.02)
    reaches = (
        Reach(1 - foot, arms, guard, True, 0.5),
        Reach(foot, arms, counter, True, 0.7),
    )
    walk = enter(cue, event - 0.45)
    path = route(0.0, -cue.stand - walk.z, walk, *leave(cue, gone + 0.45))
    return Part(path, reaches=reaches, leans=(lean,), kick=leg)


def _kicked(cue: Cue) -> Part:
    own, begin = cue.own, cue.response
    force = float(np.clip(cue.script.vigour * own.strength, 0.45, 1.8))
    way = (0.34, 0.16, 0.26)[own.manner] * force
    aside = (0.0, 0.30 * own.side, 0.05 * own.side)[own.manner]
    flinch = Move(begin, begin + 0.6 + 0.3 * way, aside, -way, -0.3 * np.sign(aside) * abs(aside), ease=0.3)
    spell = Spell(begin, begin + 0.25, begin + 0.45, begin + 1.05)
    lean = (
        Lean(spell, pitch=0.30 * force, nod=0.15, crouch=0.05, ahead=-0.10 * force),
        Lean(spell, roll=-0.18 * own.side, twist=0.45 * own.side, crouch=0.03),
        Lean(spell, pitch=0.20 * force, twist=-0.35 * own.side, ahead=-0.06),
    )[own.manner]
    walk = enter(cue, cue.event - 0.35 - own.early)
    belly = (fixed(0.07, -0.36, 0.18), fixed(-0.07, -0.33, 0.18))
    fend = fixed(own.side * 0.12, -0.42, 0.30)
    near = int(own.side < 0)
    reaches = (
        tuple(Reach(hand, spell, belly[hand], True, 0.5) for hand in (0, 1)),
        tuple(Reach(hand, spell, fixed(s * 0.30, -0.2, 0.2), True, 0.8) for hand, s in ((0, 1.0), (1, -1.0))),
        (Reach(near, spell, fend, True, 0.4),),
    )[own.manner]
    return Part(route(0.0, -cue.stand - walk.z, walk, flinch), hurry=1.4, reaches=reaches, leans=(lean,))


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
        Reach(1 - hand, Spell(ready, ready + 0.4, event + 0.3, event + 0.9), fixed(-sign * 0.13, -0.06, 0.24), True),
    )
    leans = (
        Lean(Spell(ready, ready + 0.35, ready + 0.36, event), twist=0.35 * sign * own.strength),
        Lean(Spell(event - 0.25, event, back, back + 0.6), twist=-0.5 * sign, pitch=0.12, ahead=0.06),
    )
    way = 0.10 + 0.15 * own.more[5]
    path = route(0.0, -cue.stand - cue.entry - way, *_step_in(cue, way))
    return Part(path, hurry=1.2, reaches=reaches, leans=leans)


def _struck(cue: Cue) -> Part:
    own, begin = cue.own, cue.response
    force = float(np.clip(cue.script.vigour * own.strength, 0.45, 1.8))
    way = (0.26, 0.14, 0.18)[own.manner] * force
    aside = (0.0, 0.14 * own.side, 0.0)[own.manner]
    stagger = Move(begin + 0.03, begin + 0.6 + 0.3 * way, aside, -way, 0.6 * aside, ease=0.3)
    jolt = Spell(begin, begin + 0.17, begin + 0.3, begin + 0.9)
    lean = (
        Lean(jolt, pitch=-0.20 * force, nod=-0.22),
        Lean(jolt, pitch=-0.05, roll=-0.20 * own.side * force, twist=0.50 * own.side, nod=0.1),
        Lean(jolt, pitch=-0.12 * force, crouch=0.06, nod=0.2),
    )[own.manner]
    walk = enter(cue, cue.event - 0.35 - own.early)
    near = int(own.side < 0)
    cover = Spell(begin + 0.05, begin + 0.35, begin + 0.75, begin + 1.3)
    touch = (Reach(near, cover, fixed(own.side * 0.07, 0.10, 0.17), True, 0.4),)
    both = tuple(Reach(hand, cover, fixed(s * 0.09, 0.08, 0.22), True, 0.35) for hand, s in ((0, 1.0), (1, -1.0)))
    reaches = (touch if own.more[4] < 0.6 else (), touch, both)[own.manner]
    if own.manner == 0:
        reaches = (*reaches, *free_hand(cue, 1 - near))
    path = route(0.0, -cue.stand - walk.z, walk, stagger)
    return Part(path, hurry=1.4, reaches=reaches, leans=(lean,))
