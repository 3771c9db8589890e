"""Reactions in a folder: an interaction each, ``person_a`` the partner, ``person_b`` the reaction.

A reaction's name is its clip's, ``#``, the person who reacts, ``#`` and the number of the sample;
``#`` sorts before every character of a clip's name but itself, so reactions come in their clips'
order.
"""

import hashlib
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from pacmo_core.data.interaction import Interaction, Motion
from pacmo_core.store.motions import read_skeleton, write_motions
from pacmo_core.store.tables import ClipRecord
from stages._clips import stream_side
from stages._files import MOTIONS

ROLES = ("a", "b")


MOST_SAMPLES = 10  # numbers of one digit sort as they count


def directed_clips(
    clips: Path, sides: Path, side: str
) -> Iterator[tuple[str, ClipRecord, Interaction]]:
    """Yield every clip of a side twice, either person as partner: name, facts, partner first.

    The name is the clip's, ``#`` and the person who reacts.
    """
    for facts, interaction in stream_side(clips, sides, side):
        for role in ROLES:
            seen = interaction.swapped() if role == "a" else interaction
            yield f"{facts.clip}#{role}", facts, seen


def write_reactions(
    clips: Path,
    sides: Path,
    reactions: Path,
    react: Callable[[str, ClipRecord, Interaction], Iterable[Motion]],
) -> None:
    """Let ``react`` answer the partner of every test clip, either person, once or more.

    Raises
    ------
    ValueError
        If there are more than ten answers to a partner.
    """
    with write_motions(reactions / MOTIONS, read_skeleton(clips / MOTIONS)) as writer:
        for name, facts, seen in directed_clips(clips, sides, "test"):
            for number, answer in enumerate(react(name, facts, seen)):
                if number == MOST_SAMPLES:
                    raise ValueError(f"{name}: wanted at most {MOST_SAMPLES} reactions, got more")
                both = Interaction(seen.skeleton, seen.times, seen.person_a, answer)
                writer.add(f"{name}#{number}", both)


def seed_of(name: str, random_seed: int) -> int:
    """Give every reaction a seed of its own, so that another clip changes none."""
    digest = hashlib.blake2b(f"{random_seed}\0{name}".encode(), digest_size=7).digest()
    return int.from_bytes(digest)
