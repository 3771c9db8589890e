"""Draws of what two people share: when it happens, where they stand, how they are seen."""

from typing import NamedTuple

import numpy as np

from pacmo_core.synthesis.body import Body, Subject

RATE = 30.0  # frames a second that a Kinect aims at
SHORTEST, LONGEST = 1.5, 4.0  # seconds
TAIL = 0.35  # seconds that a clip goes on after a contact, at least
JITTER = 0.002  # seconds, standard deviation of when a frame is taken

# Seconds that a contact lasts, from and to.
HOLD = {
    "approach": (0.0, 0.0),
    "depart": (0.0, 0.0),
    "handshake": (0.6, 1.2),
    "high five": (0.05, 0.10),
    "push": (0.10, 0.16),
    "kick": (0.04, 0.07),
    "punch": (0.04, 0.07),
    "hug": (0.7, 1.3),
    "hand over": (0.25, 0.5),
    "circle dance": (1.6, 2.3),
}
HIGH = 0.5  # of an arm: how far above or below the shoulder a contact may be
CHEST = 0.11  # metres from the spine to the front of the chest


class Timing(NamedTuple):
    """When: fields of ``Script`` of the same names."""

    event: float
    hold: float
    duration: float
    entry: tuple[float, float]
    vigour: float
    beat: float
    turn: float
    stays: bool


class Places(NamedTuple):
    """Where: fields of ``Script`` of the same names."""

    stand: tuple[float, float]
    hands: tuple[int, int]
    aside: float
    level: float


def timing(random: np.random.Generator, act: str, tempo: float) -> Timing:
    """Draw the clock of an act for two people of a mean tempo."""
    hold = float(random.uniform(*HOLD[act])) / tempo
    walks = random.random() < 0.65
    near = random.uniform(0.25, 0.75, 2) * (1.0 if walks else 0.0)
    entry = random.uniform(0.8, 1.4, 2) if act in ("approach", "depart") else near
    event = _event(random, act, float(entry.max()), tempo)
    hold = min(hold, LONGEST - TAIL - event)
    tail = random.uniform(0.35, 0.7) if act == "approach" else random.uniform(0.8, 1.3)
    tail = max(tail, float(entry.max()) / 1.1 + 1.0) if act == "depart" else tail
    way = -1.0 if random.random() < 0.5 else 1.0
    return Timing(
        event=event,
        hold=hold,
        duration=float(np.clip(event + hold + tail, SHORTEST, LONGEST)),
        entry=(float(entry[0]), float(entry[1])),
        vigour=float(np.exp(random.normal(0.0, 0.22))),
        beat=float(random.uniform(2.2, 3.2)),
        turn=float(way * (0.9 * hold if act == "circle dance" else random.uniform(0.0, 0.5))),
        stays=bool(random.random() < 0.6),
    )


def _event(random: np.random.Generator, act: str, entry: float, tempo: float) -> float:
    slack = random.uniform(0.0, 0.35)
    if act == "depart":
        return float(0.35 + slack)
    return float((0.8 + slack + entry / 1.05) / tempo)


def places(
    random: np.random.Generator, act: str, people: tuple[Subject, Subject], first: int
) -> Places:
    """Draw where two people meet so that both can reach, ``first`` (0 or 1) being who acts."""
    actor, other = people[first].body, people[1 - first].body
    hands = _hands(random, act, people, first)
    shoulders = [0.5 * (p.body.shoulder_height - 0.03) for p in people]
    shoulder = float(sum(shoulders))
    ease = float(random.uniform(0.90, 1.0))
    if act in ("push", "punch", "kick"):
        level, gap = _blow(random, act, actor, other)
        return Places((0.5 * gap, 0.5 * gap), hands, float(random.normal(0.0, 0.015)), level)
    if act in ("approach", "depart"):
        apart = random.uniform(0.38, 0.6, 2)
        return Places((float(apart[0]), float(apart[1])), hands, 0.0, shoulder)
    if act == "hug":
        near = float(random.uniform(0.165, 0.20))
        return Places((near, near), hands, float(random.uniform(0.05, 0.08)), shoulder)
    lift = {"handshake": -0.30, "high five": 0.24, "hand over": -0.24, "circle dance": -0.17}[act]
    wanted = shoulder + lift + float(random.uniform(-0.05, 0.05))
    level = _within_reach(wanted, [p.body for p in people])
    stretch = 0.70 if act == "circle dance" else 0.80
    near_a, near_b = (ease * _comfortable(p.body, level, stretch) for p in people)
    sides = [(1.0 - 2.0 * hands[0]), -(1.0 - 2.0 * hands[1])]
    aside = float(sum(sides)) * 0.08 + float(random.normal(0.0, 0.02))
    return Places((near_a, near_b), hands, aside, level)


def _hands(
    random: np.random.Generator, act: str, people: tuple[Subject, Subject], first: int
) -> tuple[int, int]:
    """Choose hands: 0 left, 1 right. All shake with the right; else mostly the hand one prefers."""
    liked = [int(p.handedness < 0) for p in people]
    flips = random.random(2) < 0.2
    own = [side ^ int(flip) for side, flip in zip(liked, flips, strict=True)]
    if act == "handshake":
        return 1, 1
    if act in ("high five", "hug"):
        return own[first], own[first]
    return own[0], own[1]


def _within_reach(level: float, bodies: list[Body]) -> float:
    """Give the level nearest to one wanted that is not far above or below anyone's shoulder."""
    low = max(body.shoulder_height - 0.03 - HIGH * body.arm for body in bodies)
    high = min(body.shoulder_height - 0.03 + HIGH * body.arm for body in bodies)
    return min(max(level, low), high)


def _comfortable(body: Body, level: float, stretch: float) -> float:
    """How far ahead of the pelvis a hand at ``level`` is when the arm is stretched so far."""
    drop = body.shoulder_height - 0.03 - level
    lean = 0.05
    return lean + float(np.sqrt((stretch * body.arm) ** 2 - drop**2 - body.shoulder_half**2))


def _blow(random: np.random.Generator, act: str, actor: Body, other: Body) -> tuple[float, float]:
    """Give the level at which a blow lands, and the metres between the pelvises."""
    if act == "kick":
        level = float(random.uniform(0.40, 0.54)) * other.stature
        hip = actor.leg + actor.ankle_height - 0.04
        reach = float(np.sqrt((0.93 * actor.leg) ** 2 - (hip - level) ** 2))
        return level, reach + CHEST + 0.06
    if act == "push":
        level = other.shoulder_height - 0.03 - float(random.uniform(0.08, 0.16))
        level = _within_reach(level, [actor])
        return level, _comfortable(actor, level, 0.74) + CHEST + 0.08
    level = other.head_height - 0.03 - float(random.uniform(0.0, 0.06))
    level = _within_reach(level, [actor])
    return level, _comfortable(actor, level, 0.84) + CHEST + 0.24


def view(
    random: np.random.Generator, setup: int, camera: int
) -> tuple[float, float, float, float, float]:
    """Place the camera: three stand 45 degrees apart; a setup has its height and distance."""
    side = (0.0, -0.25, 0.25)[camera - 1] * np.pi + (np.pi if random.random() < 0.5 else 0.0)
    yaw = side + random.normal(0.0, 0.2)
    pitch = random.normal(0.0, 0.02)
    height = 0.9 + 0.05 * (setup * 5 % 8) + random.normal(0.0, 0.01)
    distance = 3.0 + 0.1 * (setup * 3 % 8) + random.normal(0.0, 0.08)
    return float(yaw), float(pitch), float(height), float(distance), float(random.normal(0.0, 0.12))


def instants(random: np.random.Generator, duration: float) -> tuple[float, ...]:
    """Say when each frame is taken: at 30 a second, give or take a few milliseconds."""
    late = random.normal(0.0, JITTER, round(duration * RATE)).clip(-4 * JITTER, 4 * JITTER)
    times = np.arange(len(late)) / RATE + late
    return tuple((times - min(0.0, times[0])).tolist())
