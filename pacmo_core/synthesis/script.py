"""What two people agree on: everything about a clip that neither chooses alone.

Given a script the two people's motions are independent; that is what makes a fresh draw of either
one's motion an exact draw of the reaction to the other (see ``capture``).
"""

from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields
from typing import Any, Literal

import numpy as np

from pacmo_core.synthesis.body import Subject, pair_of
from pacmo_core.synthesis.staging import instants, places, timing, view

Role = Literal["a", "b"]

# The nearest NTU RGB+D action. NTU has no dance: two people who move hand in hand are A119's.
ACTS = {
    "approach": "A059",
    "depart": "A060",
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
    population, pair : who: the seed of the population, and which pair of it, from 1
    act : a key of ``ACTS``
    setup, camera, replication : the numbers in an NTU file name
    initiator : who acts: the other responds
    event : seconds at which the act comes to its point (hands meet, a blow lands)
    hold : seconds that a contact lasts
    duration : seconds
    entry : metres that each person, a and b, comes from or goes to
    stand : metres from each person's pelvis to the meeting plane at the event
    hands : the hand each person uses, 0 left, 1 right
    aside, level : metres: place of the contact left of person a's midline, and its height
    vigour : strength of the act, about 1
    beat : hertz, of what repeats
    turn : radians that the pair turns, or the way in which they part; positive to the left
    stays : whether both stay where they stand after the event
    view : the camera: yaw and pitch (radians), its height, its distance, its miss aside (metres)
    instants : seconds, when each frame was really taken
    """

    population: int
    pair: int
    act: str
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
    vigour: float
    beat: float
    turn: float
    stays: bool
    view: tuple[float, float, float, float, float]
    instants: tuple[float, ...]

    @property
    def people(self) -> tuple[Subject, Subject]:
        """Person a and person b."""
        return pair_of(self.population, self.pair)

    def to_json(self) -> dict[str, Any]:
        """Give a dictionary of numbers, words and lists of numbers."""
        return {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in asdict(self).items()
        }

    @classmethod
    def from_json(cls, words: dict[str, Any]) -> "Script":
        """Read back what ``to_json`` gave.

        Raises
        ------
        ValueError
            If a variable is missing or unknown.
        """
        wanted = {field.name for field in fields(cls)}
        if wanted != set(words):
            raise ValueError(f"a script has {sorted(wanted)}; got {sorted(words)}")
        values: dict[str, Any] = {
            name: tuple(word) if isinstance(word, list) else word for name, word in words.items()
        }
        return cls(**values)


def file_name(script: Script) -> str:
    """Name a clip as NTU RGB+D does, without the ending; P is the pair."""
    return (
        f"S{script.setup:03d}C{script.camera:03d}P{script.pair:03d}"
        f"R{script.replication:03d}{ACTS[script.act]}"
    )


def write_script(
    random: np.random.Generator,
    *,
    population: int,
    pair: int,
    act: str,
    replication: int,
) -> Script:
    """Draw the shared variables of one clip; setup and camera follow from pair and replication.

    Raises
    ------
    ValueError
        If the act is unknown, or pair or replication does not fit NTU's three digits.
    """
    if act not in ACTS or not 1 <= pair <= 999 or not 1 <= replication <= 999:
        raise ValueError(
            f"wanted an act of {', '.join(ACTS)}, pair and replication of 1 to 999; "
            f"got {act!r}, {pair}, {replication}"
        )
    a, b = pair_of(population, pair)
    initiator: Role = "a" if random.random() < 0.5 else "b"
    when = timing(random, act, 0.5 * (a.tempo + b.tempo))
    where = places(random, act, (a, b), "ab".index(initiator))
    setup, camera = 1 + (pair - 1) % 17, 1 + (replication - 1) % 3
    return Script(
        population=population,
        pair=pair,
        act=act,
        setup=setup,
        camera=camera,
        replication=replication,
        initiator=initiator,
        **when._asdict(),
        **where._asdict(),
        view=view(random, setup, camera),
        instants=instants(random, when.duration),
    )


def write_scripts(
    random_seed: int, *, population: int, pairs: int, acts: tuple[str, ...], replications: int
) -> Iterator[tuple[Script, np.random.Generator]]:
    """Write every pair's clips, each with the generator that is to perform it.

    A clip's generator comes from its own names, so more pairs, acts or replications change no clip.
    """
    for pair in range(1, pairs + 1):
        for act in acts:
            for replication in range(1, replications + 1):
                names = [random_seed, population, pair, int(ACTS[act][1:]), replication]
                writer, performer = np.random.default_rng(names).spawn(2)
                yield (
                    write_script(
                        writer, population=population, pair=pair, act=act, replication=replication
                    ),
                    performer,
                )
