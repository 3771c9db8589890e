"""Acts of meeting: approach, depart, handshake, high five, hand over."""

import numpy as np

from pacmo_core.synthesis.curves import Array
from pacmo_core.synthesis.direct import Cue, Move, contact, enter, free_hand, leave, route, shaken
from pacmo_core.synthesis.part import Lean, Part, Reach, Spell, fixed


def approach(cue: Cue) -> Part:
    """Walk toward each other; some wave or nod."""
    arrive = cue.event - 0.25 + 0.5 * cue.own.delay
    walk = enter(cue, arrive)
    leans: tuple[Lean, ...] = ()
    hand = int(cue.own.side < 0)
    reaches = free_hand(cue, hand) if cue.own.idle == 3 else ()
    if cue.own.manner == 1:
        leans = (Lean(Spell(arrive - 0.3, arrive + 0.05, arrive + 0.1, arrive + 0.6), nod=0.3),)
    if cue.own.manner == 2:
        reaches = (_wave(cue, hand, arrive - 0.6),)
    return Part(route(0.0, -cue.stand - walk.z, walk), reaches=reaches, leans=leans)


def depart(cue: Cue) -> Part:
    """Turn away over the left or the right and walk off; some wave, some step back first."""
    own = cue.own
    begin = cue.event + own.delay + (0.35 if own.manner == 1 else 0.0)
    stray = 0.4 * cue.script.turn + 0.2 * (own.more[1] - 0.5)
    backward = 0.25 if own.manner == 2 else 0.0
    way = cue.entry - backward
    pace = 1.05 * cue.me.tempo * (0.9 + 0.25 * own.more[0])
    go = Move(begin + 0.35, begin + 0.95 + way / pace, -way * np.sin(stray), -way * np.cos(stray))
    turn = Move(begin, begin + 1.5, yaw=own.side * np.pi + stray, ease=0.4)
    back = Move(begin - 0.3, begin + 0.6, z=-backward)
    hand = int(own.side < 0)
    reaches = (_wave(cue, hand, 0.1),) if own.manner == 1 else free_hand(cue, hand)
    lean = Lean(Spell(begin - 0.1, begin + 0.25, begin + 0.45, begin + 0.95), twist=0.3 * own.side)
    return Part(route(0.0, -cue.stand, back, turn, go), hurry=1.25, reaches=reaches, leans=(lean,))


def _wave(cue: Cue, hand: int, start: float) -> Reach:
    sign, size = 1.0 - 2.0 * hand, cue.me.body.stature

    def course(times: Array) -> Array:
        x = sign * (0.16 * size + 0.05 * np.sin(2.0 * np.pi * 2.2 * (times - start)))
        return np.stack([x, np.full_like(x, 0.12 * size), np.full_like(x, 0.10 * size)], axis=-1)

    return Reach(
        hand,
        Spell(start, start + 0.45, start + 0.85, start + 1.35),
        course,
        True,
        0.5,
        (sign * 0.12, 0.0, 0.2),
    )


def handshake(cue: Cue) -> Part:
    """Join right hands and shake them; some cover with the other hand, some bow."""
    own = cue.own
    start = cue.event - 0.5 - (own.early if cue.first else -0.4 * own.delay)
    gone = cue.over + 0.1 * own.more[4]
    shake = Reach(
        cue.hand,
        Spell(start, cue.event, gone, gone + 0.45 + 0.2 * own.more[5]),
        shaken(cue, contact(cue, 0.008)),
    )
    twist = 0.12 * (2.0 * cue.hand - 1.0)
    leans = [Lean(shake.spell, pitch=0.07 * own.strength, twist=twist, ahead=0.02)]
    other = free_hand(cue, 1 - cue.hand)
    if own.manner == 1:
        cover = Spell(
            cue.event + 0.5 * own.delay, cue.event + 0.45 + own.delay, gone - 0.02, gone + 0.5
        )
        x, y, z = contact(cue, 0.05)
        goal = shaken(cue, (x + 0.03 * (1.0 - 2.0 * (1 - cue.hand)), y + 0.05, z))
        other = (Reach(1 - cue.hand, cover, goal),)
        leans.append(Lean(cover, pitch=0.10, twist=-twist, ahead=0.03))
    if own.manner == 2:
        bow = Spell(cue.event - 0.2, cue.event + 0.25, cue.event + 0.3, cue.event + 0.9)
        leans.append(Lean(bow, pitch=0.12 * own.strength, nod=0.25, ahead=-0.07 * own.strength))
    path = route(
        0.0,
        -cue.stand - cue.entry,
        enter(cue, cue.event - 0.1 - own.early),
        *leave(cue, gone + 0.1),
    )
    return Part(path, reaches=(shake, *other), leans=tuple(leans))


def high_five(cue: Cue) -> Part:
    """Clap raised hands together; some swing wide, some hop into it."""
    own = cue.own
    start = cue.event - 0.55 - (own.early if cue.first else -0.4 * own.delay)
    sign = 1.0 - 2.0 * cue.hand
    clap = Reach(
        cue.hand,
        Spell(start, cue.event, cue.over, cue.over + 0.5 + 0.25 * own.more[4]),
        fixed(*contact(cue, 0.008)),
        flare=0.3 + 0.4 * own.more[5],
        detour=(sign * 0.12 * own.strength, 0.0, 0.12),
    )
    leans = [Lean(clap.spell, pitch=0.04, twist=-0.15 * sign, aside=0.0)]
    if own.manner == 1:
        dip = Spell(start - 0.1, start + 0.2, start + 0.2, cue.event + 0.05)
        leans.append(Lean(dip, crouch=0.06 * own.strength, twist=0.2 * sign))
    if own.manner == 2:
        after = Spell(cue.over, cue.over + 0.3, cue.over + 0.4, cue.over + 0.9)
        leans.append(Lean(after, twist=0.35 * sign, crouch=0.04 * own.strength, nod=0.15))
    path = route(
        0.0, -cue.stand - cue.entry, enter(cue, cue.event - 0.1 - own.early), *leave(cue, cue.over)
    )
    return Part(path, reaches=(clap, *free_hand(cue, 1 - cue.hand)), leans=tuple(leans))


def hand_over(cue: Cue) -> Part:
    """Give a thing a hand's breadth long; it is taken with one hand or two."""
    own, size = cue.own, cue.me.body.stature
    sign = 1.0 - 2.0 * cue.hand
    start = cue.event - 0.55 - (0.2 + own.early if cue.first else -0.4 * own.delay)
    gone = cue.over + 0.1 * own.more[4]
    give = Reach(cue.hand, Spell(start, cue.event, gone, gone + 0.5), fixed(*contact(cue, 0.04)))
    held = fixed(sign * 0.08 * size, -0.20 * size, 0.16 * size)
    kept = (
        Spell(-2.0, -1.5, start + 0.1, cue.event)
        if cue.first
        else Spell(gone, gone + 0.5, 9.0, 9.9)
    )
    leans = [Lean(give.spell, pitch=0.06 * own.strength, twist=-0.12 * sign, ahead=0.02)]
    reaches = (Reach(cue.hand, kept, held, True), give)
    other = free_hand(cue, 1 - cue.hand)
    if own.manner == 1:
        x, y, z = contact(cue, 0.05)
        late = Spell(start + 0.1, cue.event + 0.05, gone, gone + 0.55)
        other = (Reach(1 - cue.hand, late, fixed(x - 0.05 * sign, y - 0.03, z)),)
        leans.append(Lean(late, pitch=0.08, twist=0.12 * sign, ahead=0.02))
    if own.manner == 2:
        thanks = Spell(gone, gone + 0.35, gone + 0.45, gone + 0.95)
        leans.append(Lean(thanks, pitch=0.12 * own.strength, nod=0.25))
    path = route(
        0.0,
        -cue.stand - cue.entry,
        enter(cue, cue.event - 0.1 - own.early),
        *leave(cue, gone + 0.1),
    )
    return Part(path, reaches=(*reaches, *other), leans=tuple(leans))
