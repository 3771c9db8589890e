"""The shared variables of a clip: timing, placement, camera view; sampled for each clip.

Given a script the two people's motions are conditionally independent, so a new sample of one
person's motion is an exact sample of the reaction to the other (see ``capture``).
"""

from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields
from typing import Any, Literal, NamedTuple

import numpy as np

from pacmo_core.synthesis.body import Subject, SyntheticBody, sample_pair

FPS = 30.0  # nominal frame rate of a Kinect
MIN_DURATION, MAX_DURATION = 1.5, 4.0  # seconds
MIN_TAIL = 0.35  # seconds after a contact, at least
FRAME_JITTER = 0.002  # seconds, standard deviation of frame times

# Range of the duration of a contact, seconds.
CONTACT_SECONDS = {
    "approach": (0.0, 0.0),
    "depart": (0.0, 0.0),
    "point": (0.6, 1.6),  # of the gesture
    "handshake": (0.6, 1.2),
    "high five": (0.05, 0.10),
    "push": (0.10, 0.16),
    "kick": (0.04, 0.07),
    "punch": (0.04, 0.07),
    "hug": (0.7, 1.3),
    "hand over": (0.25, 0.5),
    "circle dance": (1.6, 2.3),
}
STRIKES = ("push", "kick", "punch")
APART = ("approach", "depart", "point")  # acts without contact
MAX_CONTACT_HEIGHT = 0.5  # of the arm length: largest height difference of contact and shoulder
MAX_PASSING = 0.44  # metres between the lines of two who give the same hand
MAX_ACROSS = 0.22  # metres, largest distance to the side that an arm's reach allows for
CHEST_DEPTH = 0.11  # metres from the spine to the front of the chest


class Timing(NamedTuple):
    """The timing: fields of ``Script`` of the same names."""

    event: float
    hold: float
    duration: float
    entry: tuple[float, float]
    vigour: float
    beat: float
    turn: float
    stays: bool


class Placement(NamedTuple):
    """The placement: fields of ``Script`` of the same names."""

    stand: tuple[float, float]
    hands: tuple[int, int]
    aside: float
    level: float
    passing: float


def sample_timing(random: np.random.Generator, action: str, tempo: float) -> Timing:
    """Sample the timing of an action for two people of a mean tempo."""
    hold = float(random.uniform(*CONTACT_SECONDS[action])) / tempo
    walks = random.random() < 0.65
    near = random.uniform(0.25, 0.95, 2) * (1.0 if walks else 0.0)
    entry = random.uniform(0.8, 1.4, 2) if action in ("approach", "depart") else near
    event = _sample_event(random, action, float(entry.max()), tempo)
    hold = min(hold, MAX_DURATION - MIN_TAIL - event)
    tail = random.uniform(0.8 if action in STRIKES else 0.45, 1.3)
    tail = min(tail, 0.7) if action == "approach" else tail
    tail = max(tail, float(entry.max()) / 1.1 + 1.0) if action == "depart" else tail
    sign = -1.0 if random.random() < 0.5 else 1.0
    return Timing(
        event=event,
        hold=hold,
        duration=float(np.clip(event + hold + tail, MIN_DURATION, MAX_DURATION)),
        entry=(float(entry[0]), float(entry[1])),
        vigour=float(np.exp(np.clip(random.normal(0.0, 0.35), -0.7, 0.7))),
        beat=float(random.uniform(2.2, 3.2)),
        turn=float(sign * (0.9 * hold if action == "circle dance" else random.uniform(0.0, 0.5))),
        stays=bool(random.random() < 0.6),
    )


def _sample_event(random: np.random.Generator, action: str, entry: float, tempo: float) -> float:
    slack = random.uniform(0.0, 0.9)
    if action == "depart":
        return float(0.35 + slack)
    if action not in STRIKES:
        slack = 1.4 * slack - 0.4  # a recording may begin as a hand comes up
    return float((0.8 + slack + entry / 1.05) / tempo)


def sample_placement(
    random: np.random.Generator, action: str, people: tuple[Subject, Subject], first: int
) -> Placement:
    """Sample positions from which both can reach; ``first`` (0 or 1) is the initiator."""
    hands = _sample_hands(random, action, people, first)
    if action in STRIKES:
        return _place_strike(random, action, people[first].body, people[1 - first].body, hands)
    if action in APART:
        return _place_apart(random, action, people, hands)
    if action == "hug":
        near = float(random.uniform(0.165, 0.20))
        passing = (1.0 if hands[0] == 1 else -1.0) * float(random.uniform(0.15, 0.21))
        return Placement((near, near), hands, 0.0, _mean_shoulder_height(people), passing)
    return _place_hands(random, action, people, hands)


def _place_apart(
    random: np.random.Generator,
    action: str,
    people: tuple[Subject, Subject],
    hands: tuple[int, int],
) -> Placement:
    """Sample positions of two who do not touch."""
    nearest, farthest = (0.45, 0.85) if action == "point" else (0.38, 0.6)
    apart = random.uniform(nearest, farthest, 2)
    passing = float(random.uniform(-0.3, 0.3))
    stand = float(apart[0]), float(apart[1])
    return Placement(stand, hands, 0.0, _mean_shoulder_height(people), passing)


def _place_hands(
    random: np.random.Generator,
    action: str,
    people: tuple[Subject, Subject],
    hands: tuple[int, int],
) -> Placement:
    """Sample where hands meet, and positions from which both reach it."""
    lift = {"handshake": -0.30, "high five": 0.24, "hand over": -0.24, "circle dance": -0.17}[
        action
    ]
    target = _mean_shoulder_height(people) + lift + float(random.uniform(-0.15, 0.15))
    level = _clip_to_reach(target, [p.body for p in people])
    side_a, side_b = 1.0 - 2.0 * hands[0], 1.0 - 2.0 * hands[1]
    aside = (side_a - side_b) * 0.08 + float(random.uniform(-0.1, 0.1))
    passing, stretch = 0.0, float(random.uniform(0.78, 0.97))
    if action == "circle dance":
        stretch = 0.70 * float(random.uniform(0.9, 1.0))
        across = (people[0].body.shoulder_half, people[1].body.shoulder_half)
    else:
        if hands[0] == hands[1]:
            turn = 1.0 if hands[0] == 1 else -1.0
            passing = turn * float(random.uniform(0.0, MAX_PASSING))
        across = (
            aside - 0.5 * passing - side_a * people[0].body.shoulder_half,
            -aside - 0.5 * passing - side_b * people[1].body.shoulder_half,
        )
    near_a, near_b = (
        _reach_distance(person.body, level, stretch, min(abs(far), MAX_ACROSS))
        for person, far in zip(people, across, strict=True)
    )
    return Placement((near_a, near_b), hands, aside, level, passing)


def _mean_shoulder_height(people: tuple[Subject, Subject]) -> float:
    return float(sum(0.5 * (person.body.shoulder_height - 0.03) for person in people))


def _sample_hands(
    random: np.random.Generator, action: str, people: tuple[Subject, Subject], first: int
) -> tuple[int, int]:
    """Sample hands: 0 left, 1 right. Handshakes use the right, others mostly the preferred hand."""
    preferred = [int(p.handedness < 0) for p in people]
    flips = random.random(2) < 0.2
    hand_of = [side ^ int(flip) for side, flip in zip(preferred, flips, strict=True)]
    if action == "handshake":
        return 1, 1
    if action in ("high five", "hug"):
        return hand_of[first], hand_of[first]
    return hand_of[0], hand_of[1]


def _clip_to_reach(level: float, bodies: list[SyntheticBody]) -> float:
    """Clip a height to the range that the arms of all bodies reach."""
    low = max(body.shoulder_height - 0.03 - MAX_CONTACT_HEIGHT * body.arm for body in bodies)
    high = min(body.shoulder_height - 0.03 + MAX_CONTACT_HEIGHT * body.arm for body in bodies)
    return min(max(level, low), high)


def _reach_distance(body: SyntheticBody, level: float, stretch: float, across: float) -> float:
    """Return the distance ahead of the pelvis of a hand at ``level``, for an arm extension.

    ``across`` is the distance, to the side, from the shoulder to the hand.
    """
    drop = body.shoulder_height - 0.03 - level
    lean = 0.05
    return lean + float(np.sqrt((stretch * body.arm) ** 2 - drop**2 - across**2))


def _place_strike(
    random: np.random.Generator,
    action: str,
    actor: SyntheticBody,
    other: SyntheticBody,
    hands: tuple[int, int],
) -> Placement:
    """Sample the height of a strike, and positions in which it lands."""
    if action == "kick":
        level = float(random.uniform(0.40, 0.54)) * other.stature
        hip = actor.leg + actor.ankle_height - 0.04
        reach, depth = float(np.sqrt((0.93 * actor.leg) ** 2 - (hip - level) ** 2)), 0.06
    else:
        wanted, stretch, depth = (
            (other.shoulder_height - 0.03 - float(random.uniform(0.08, 0.16)), 0.74, 0.08)
            if action == "push"
            else (other.head_height - 0.03 - float(random.uniform(0.0, 0.06)), 0.84, 0.24)
        )
        level = _clip_to_reach(wanted, [actor])
        reach = _reach_distance(actor, level, stretch, actor.shoulder_half)
    near = 0.5 * (reach + CHEST_DEPTH + depth)
    return Placement((near, near), hands, float(random.normal(0.0, 0.015)), level, 0.0)


def sample_view(
    random: np.random.Generator, setup: int, camera: int
) -> tuple[float, float, float, float, float]:
    """Sample the pose of the camera: three are 45 degrees apart; height and distance by setup."""
    side = (0.0, -0.25, 0.25)[camera - 1] * np.pi + (np.pi if random.random() < 0.5 else 0.0)
    yaw = side + random.normal(0.0, 0.2)
    pitch = random.normal(0.0, 0.02)
    height = 0.9 + 0.05 * (setup * 5 % 8) + random.normal(0.0, 0.01)
    distance = 3.0 + 0.1 * (setup * 3 % 8) + random.normal(0.0, 0.08)
    return float(yaw), float(pitch), float(height), float(distance), float(random.normal(0.0, 0.12))


def sample_frame_times(random: np.random.Generator, duration: float) -> tuple[float, ...]:
    """Sample the time of each frame: 30 fps with a jitter of milliseconds."""
    late = random.normal(0.0, FRAME_JITTER, round(duration * FPS)).clip(
        -4 * FRAME_JITTER, 4 * FRAME_JITTER
    )
    times = np.arange(len(late)) / FPS + late
    return tuple((times - min(0.0, times[0])).tolist())


Role = Literal["a", "b"]

# The nearest NTU RGB+D action. NTU has no dance; in A119 two people move hand in hand. Of its acts
# without contact A054, in which one points at the other, is nearest to two who talk.
ACTIONS = {
    "approach": "A059",
    "depart": "A060",
    "point": "A054",
    "handshake": "A058",
    "high five": "A112",
    "push": "A052",
    "kick": "A051",
    "punch": "A050",
    "hug": "A055",
    "hand over": "A056",
    "circle dance": "A119",
}


@dataclass(frozen=True)
class Script:
    """The shared variables of one clip.

    Parameters
    ----------
    population, pair : the seed of the population, and the number of the pair, from 1
    action : a key of ``ACTIONS``
    setup, camera, replication : the numbers in an NTU file name
    initiator : the person who acts; the other responds
    event : seconds of the main event (hands meet, a strike lands)
    hold : seconds that a contact lasts
    duration : seconds
    entry : metres that each person, a and b, walks in or out
    stand : metres from each person's pelvis to the meeting plane at the event
    hands : the hand each person uses, 0 left, 1 right
    aside, level : metres: position of the contact to the left of person a's line, and its height
    passing : metres by which the lines on which the two come in pass each other, each to the left
        of the other's: right hands are then before each other
    vigour : strength of the action, about 1
    beat : hertz, of repeated movements
    turn : radians by which the pair turns or parts; positive to the left
    stays : whether both keep their positions after the event
    view : the camera: yaw and pitch (radians), height, distance, lateral offset (metres)
    frame_times : seconds, the true time of each frame
    """

    population: int
    pair: int
    action: str
    setup: int
    camera: int
    replication: int
    initiator: Role
    event: float
    hold: float
    duration: float
    entry: tuple[float, float]
    stand: tuple[float, float]
    hands: tuple[int, int]
    aside: float
    level: float
    passing: float
    vigour: float
    beat: float
    turn: float
    stays: bool
    view: tuple[float, float, float, float, float]
    frame_times: tuple[float, ...]

    @property
    def people(self) -> tuple[Subject, Subject]:
        """Person a and person b."""
        return sample_pair(self.population, self.pair)

    def to_json(self) -> dict[str, Any]:
        """Convert to a dictionary of numbers, strings and lists of numbers."""
        return {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in asdict(self).items()
        }

    @classmethod
    def from_json(cls, record: dict[str, Any]) -> "Script":
        """Restore from ``to_json``.

        Raises
        ------
        ValueError
            If a variable is missing or unknown.
        """
        expected = {field.name for field in fields(cls)}
        if expected != set(record):
            raise ValueError(f"a script has {sorted(expected)}; got {sorted(record)}")
        values: dict[str, Any] = {
            name: tuple(value) if isinstance(value, list) else value
            for name, value in record.items()
        }
        return cls(**values)


def file_name(script: Script) -> str:
    """Return the name of a clip as in NTU RGB+D, without the suffix; P is the pair."""
    return (
        f"S{script.setup:03d}C{script.camera:03d}P{script.pair:03d}"
        f"R{script.replication:03d}{ACTIONS[script.action]}"
    )


def sample_script(
    random: np.random.Generator,
    *,
    population: int,
    pair: int,
    action: str,
    replication: int,
) -> Script:
    """Sample the shared variables of one clip; setup and camera follow from pair and replication.

    Raises
    ------
    ValueError
        If the action is unknown, or pair or replication does not fit NTU's three digits.
    """
    if action not in ACTIONS or not 1 <= pair <= 999 or not 1 <= replication <= 999:
        raise ValueError(
            f"wanted an action of {', '.join(ACTIONS)}, pair and replication of 1 to 999; "
            f"got {action!r}, {pair}, {replication}"
        )
    a, b = sample_pair(population, pair)
    initiator: Role = "a" if random.random() < 0.5 else "b"
    timing = sample_timing(random, action, 0.5 * (a.tempo + b.tempo))
    placement = sample_placement(random, action, (a, b), "ab".index(initiator))
    setup, camera = 1 + (pair - 1) % 17, 1 + (replication - 1) % 3
    return Script(
        population=population,
        pair=pair,
        action=action,
        setup=setup,
        camera=camera,
        replication=replication,
        initiator=initiator,
        **timing._asdict(),
        **placement._asdict(),
        view=sample_view(random, setup, camera),
        frame_times=sample_frame_times(random, timing.duration),
    )


def sample_scripts(
    random_seed: int, *, population: int, pairs: int, actions: tuple[str, ...], replications: int
) -> Iterator[tuple[Script, np.random.Generator]]:
    """Sample every pair's scripts, each with the generator for its motions.

    The generator of a clip depends on its own numbers only, so that further pairs or replications
    do not change it.
    """
    for pair in range(1, pairs + 1):
        for action in actions:
            for replication in range(1, replications + 1):
                names = [random_seed, population, pair, int(ACTIONS[action][1:]), replication]
                script_generator, motion_generator = np.random.default_rng(names).spawn(2)
                yield (
                    sample_script(
                        script_generator,
                        population=population,
                        pair=pair,
                        action=action,
                        replication=replication,
                    ),
                    motion_generator,
                )
