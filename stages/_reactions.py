"""Reactions in a folder: an interaction each, ``person_a`` the partner, ``person_b`` the reaction.

Names are those of ``pacmo_core.data.names``: ``CLIP#b#0``.
"""

import hashlib
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from pacmo_core.data.interaction import Interaction, Motion
from pacmo_core.data.names import DIRECTIONS, MAX_SAMPLES, directed_name, sample_name
from pacmo_core.store.motions import read_skeleton, write_motions
from pacmo_core.store.tables import ClipRecord
from stages._clips import stream_side
from stages._files import MOTIONS


def directed_clips(
    clips: Path, sides: Path, side: str
) -> Iterator[tuple[str, ClipRecord, Interaction]]:
    """Yield every clip of a side twice, either person as partner: name, facts, partner first.

    The name is the clip's, ``#`` and the person who reacts.
    """
    for facts, interaction in stream_side(clips, sides, side):
        for direction in DIRECTIONS:
            seen = interaction.swapped() if direction == "a" else interaction
            yield directed_name(facts.clip, direction), facts, seen


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
                if number == MAX_SAMPLES:
                    raise ValueError(f"{name}: wanted at most {MAX_SAMPLES} reactions, got more")
                both = Interaction(seen.skeleton, seen.times, seen.person_a, answer)
                writer.add(sample_name(name, number), both)


def seed_of(name: str, random_seed: int) -> int:
    """Give every reaction a seed of its own, so that another clip changes none."""
    digest = hashlib.blake2b(f"{random_seed}\0{name}".encode(), digest_size=7).digest()
    return int.from_bytes(digest)
