"""How blows are taken: the reactions to push, kick and punch."""

import numpy as np

from pacmo_core.synthesis.direct import Cue, Move, enter, free_hand, route
from pacmo_core.synthesis.part import Lean, Part, Reach, Spell, fixed


def pushed(cue: Cue) -> Part:
    """Stumble back from a push: straight, round to one side, or braced against it."""
    own, begin = cue.own, cue.response
    force = float(np.clip(cue.script.vigour * own.strength, 0.45, 1.9))
    way = (0.42, 0.36, 0.12)[own.manner] * force
    yaw = (0.0, 0.7 * own.side, 0.0)[own.manner]
    aside = (0.0, 0.12 * own.side, 0.0)[own.manner]
    fall = Move(begin - 0.02, begin + 0.55 + 0.35 * way, aside, -way, yaw, ease=0.3)
    jolt = Spell(begin, begin + 0.18, begin + 0.28, begin + 0.85)
    lean = Lean(
        jolt, pitch=-0.20 * force, nod=0.15 * force, crouch=0.03 if own.manner < 2 else 0.08
    )
    twist = Lean(jolt, twist=(0.0, 0.35 * own.side, 0.0)[own.manner])
    walk = enter(cue, cue.event - 0.35 - own.early)
    path = route(0.0, -cue.stand - walk.z, walk, fall)
    fling = Spell(begin + 0.04, begin + 0.32, begin + 0.4, begin + 1.0)
    high = -0.12 - 0.1 * own.more[5]
    reaches = tuple(
        Reach(hand, fling, fixed(sign * 0.42, high, 0.14), True, 0.6, (sign * 0.12, 0.0, -0.05))
        for hand, sign in ((0, 1.0), (1, -1.0))
        if own.more[6] < 0.75 or hand == int(own.side < 0)
    )
    return Part(path, hurry=1.45, reaches=reaches, leans=(lean, twist))


def kicked(cue: Cue) -> Part:
    """Take a kick: fold over it, jump aside, or fend it off with a hand."""
    own, begin = cue.own, cue.response
    force = float(np.clip(cue.script.vigour * own.strength, 0.45, 1.8))
    way = (0.34, 0.16, 0.26)[own.manner] * force
    aside = (0.0, 0.30 * own.side, 0.05 * own.side)[own.manner]
    flinch = Move(
        begin, begin + 0.6 + 0.3 * way, aside, -way, -0.3 * np.sign(aside) * abs(aside), ease=0.3
    )
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
        tuple(
            Reach(hand, spell, fixed(s * 0.30, -0.2, 0.2), True, 0.8)
            for hand, s in ((0, 1.0), (1, -1.0))
        ),
        (Reach(near, spell, fend, True, 0.4),),
    )[own.manner]
    return Part(
        route(0.0, -cue.stand - walk.z, walk, flinch), hurry=1.4, reaches=reaches, leans=(lean,)
    )


def struck(cue: Cue) -> Part:
    """Take a blow at the face: recoil, reel to one side, or cover the face with both hands."""
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
    ahead = (0.0, 0.0, 0.18)
    touch = (Reach(near, cover, fixed(own.side * 0.07, 0.10, 0.20), True, 0.4, ahead),)
    both = tuple(
        Reach(hand, cover, fixed(s * 0.09, 0.08, 0.24), True, 0.35, ahead)
        for hand, s in ((0, 1.0), (1, -1.0))
    )
    reaches = (touch if own.more[4] < 0.6 else (), touch, both)[own.manner]
    if own.manner == 0:
        reaches = (*reaches, *free_hand(cue, 1 - near))
    path = route(0.0, -cue.stand - walk.z, walk, stagger)
    return Part(path, hurry=1.4, reaches=reaches, leans=(lean,))
