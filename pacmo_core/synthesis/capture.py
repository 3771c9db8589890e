"""Perform a script: one person, both, or the same reaction once more — the oracle.

With S the script and V_x person x's private variables, x's motion is f_x(S, V_x): given S the two
are independent. To keep S and one person's motion, and draw the other's private variables and
camera noise afresh, is thus to draw from the exact law of the reaction given S and the partner.
"""

from dataclasses import replace

import numpy as np

from pacmo_core.data.interaction import Interaction, Motion
from pacmo_core.data.skeleton import NTU25
from pacmo_core.synthesis import blows, camera, closeness, meetings
from pacmo_core.synthesis.choices import choose
from pacmo_core.synthesis.curves import Array, drift
from pacmo_core.synthesis.direct import Cue
from pacmo_core.synthesis.gait import walk
from pacmo_core.synthesis.pose import embody
from pacmo_core.synthesis.script import Role, Script
from pacmo_core.synthesis.staging import RATE

PLAYS = {
    "approach": meetings.approach,
    "depart": meetings.depart,
    "handshake": meetings.handshake,
    "high five": meetings.high_five,
    "push": blows.push,
    "kick": blows.kick,
    "punch": blows.punch,
    "hug": closeness.hug,
    "hand over": meetings.hand_over,
    "circle dance": closeness.circle_dance,
}


def true_motion(script: Script, random: np.random.Generator, role: Role) -> Array:
    """Give one person's motion as it was, before the camera: (T, 25, 3) float64, metres.

    On the stage of person a: y up, the meeting plane at z = 0, person b at positive z.
    """
    people = script.people
    index = "ab".index(role)
    me, you = people[index], people[1 - index]
    own = choose(random, me)
    part = PLAYS[script.act](Cue(script, role, me, you, own))
    gait = replace(own.gait, step_time=own.gait.step_time / part.hurry)
    times = np.array(script.instants)
    feet = walk(part.path, gait, times, script.duration)
    joints = embody(me, part, feet, times, drift(times, own.phases, own.rates))
    # Half a turn about y brings person b from b's own frame to person a's.
    return joints if role == "a" else joints * [-1.0, 1.0, -1.0]


def perform(script: Script, random: np.random.Generator, role: Role) -> Motion:
    """Draw one person's private variables and show the motion as the camera saw it.

    Returns
    -------
    (T, 25, 3) float32, metres, in the camera's frame
    """
    joints = camera.place(true_motion(script, random, role), script.view)
    return (joints + camera.noise(random, len(joints))).astype(np.float32)


def capture(script: Script, random: np.random.Generator) -> Interaction:
    """Perform both parts, each with a generator of its own spawned from ``random``: a's, then b's.

    The clock is the nominal one: like an NTU file, a capture does not say when its frames were
    really taken.
    """
    for_a, for_b = random.spawn(2)
    return Interaction(
        skeleton=NTU25,
        times=np.arange(len(script.instants)) / RATE,
        person_a=perform(script, for_a, "a"),
        person_b=perform(script, for_b, "b"),
    )


def react_oracle(script: Script, role: Role, random: np.random.Generator) -> Motion:
    """Draw ``role``'s reaction once more, the partner's motion staying what it is.

    The pair (partner, this draw) has the very law of (partner, real reaction).

    Returns
    -------
    (T, 25, 3) float32, metres, in the camera's frame
    """
    return perform(script, random, role)
