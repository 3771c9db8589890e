"""Acts of lasting nearness: the hug and the circle dance."""

import numpy as np

from pacmo_core.synthesis.curves import Array, glide, window
from pacmo_core.synthesis.direct import Cue, enter, leave, route, shaken
from pacmo_core.synthesis.gait import Path
from pacmo_core.synthesis.part import Course, Lean, Part, Reach, Spell

BACK = 0.10  # metres from the partner's spine to a palm on the back


def hug(cue: Cue) -> Part:
    """Put both arms round each other; heads go past on one side. Some pat, some rock."""
    own = cue.own
    over = cue.hand
    side = 1.0 if over == 1 else -1.0  # the head goes away from the arm that is above
    start = cue.event - 0.6 - (own.early if cue.first else -0.5 * own.delay)
    gone = cue.over + 0.12 * own.more[4]
    reaches = []
    for hand in (0, 1):
        sign = 1.0 - 2.0 * hand
        spell = Spell(start, cue.event + 0.1, gone, gone + 0.6)
        out = (sign * 0.34, 0.0, 0.0)
        reaches.append(Reach(hand, spell, _on_back(cue, hand, hand == over), False, 0.85, out))
    leans = [
        Lean(
            Spell(start + 0.1, cue.event, gone, gone + 0.5), pitch=0.12, roll=-0.10 * side, nod=0.1
        )
    ]
    if own.manner == 1:
        middle = 0.5 * (cue.event + cue.over)
        rock = Spell(cue.event, middle, middle + 0.05, cue.over + 0.1)
        leans.append(Lean(rock, roll=0.05 * own.side * own.strength))
    path = route(
        side * cue.script.aside,
        -cue.stand - cue.entry - 0.3,
        enter(cue, cue.event + 0.05, 0.3),
        *leave(cue, gone - 0.1, always=True),
    )
    return Part(path, reaches=tuple(reaches), leans=tuple(leans))


def _on_back(cue: Cue, hand: int, above: bool) -> Course:
    """Lay a palm on the partner's back; in the first manner it pats."""
    sign = 1.0 - 2.0 * hand
    side = 1.0 if cue.hand == 1 else -1.0
    middle = -side * cue.script.aside  # where the partner's spine is along my x
    low = -0.02 if above else 0.30
    spot = (middle + 0.10 * sign, cue.you.body.shoulder_height - low, cue.partner + BACK)
    pats = above and cue.own.manner == 0

    def course(times: Array) -> Array:
        patting = window(times, cue.event + 0.1, cue.event + 0.3, cue.over - 0.2, cue.over)
        lift = 0.5 - 0.5 * np.cos(2.0 * np.pi * 2.6 * (times - cue.event - 0.1))
        place: Array = np.array(spot) + np.outer(patting * lift, [0.0, 0.0, 0.035 * pats])
        return place

    return course


def circle_dance(cue: Cue) -> Part:
    """Join both hands and go round each other."""
    own, script = cue.own, cue.script
    join = cue.event - 0.1

    def angle(times: Array) -> Array:
        return script.turn * glide(times, cue.event, cue.over, 0.5)

    def round_about(course: Course) -> Course:
        def turned(times: Array) -> Array:
            x, y, z = course(times).T
            c, s = np.cos(angle(times)), np.sin(angle(times))
            return np.stack([c * x + s * z, y, c * z - s * x], axis=-1)

        return turned

    def path(times: Array) -> Array:
        x, z, yaw = walk_in(times).T
        c, s = np.cos(angle(times)), np.sin(angle(times))
        return np.stack([c * x + s * z, c * z - s * x, yaw + angle(times)], axis=-1)

    walk_in: Path = route(0.0, -cue.stand - cue.entry, enter(cue, cue.event - 0.1 - own.early))
    gone = cue.over + 0.15 * own.more[4]
    start = join - 0.6 + 0.4 * own.delay
    reaches = tuple(
        Reach(
            hand,
            Spell(start, join, gone, gone + 0.5),
            round_about(shaken(cue, (sign * 0.2, script.level, -0.01))),
            flare=0.4 + 0.3 * own.more[5],
        )
        for hand, sign in ((0, 1.0), (1, -1.0))
    )
    rock = tuple(
        Lean(
            Spell(t, t + 0.35, t + 0.36, t + 0.7),
            roll=0.07 * own.strength * side,
            crouch=0.02 * own.strength,
        )
        for t, side in zip(np.arange(cue.event, cue.over - 0.3, 0.7), (1.0, -1.0) * 4, strict=False)
    )
    return Part(path, hurry=1.15 + 0.2 * own.more[6], reaches=reaches, leans=rock)
