"""Reactions in a folder: an interaction each, ``person_a`` the partner, ``person_b`` the reaction.

A reaction's name is its clip's, ``#`` and the person who reacts; ``#`` sorts before every
character of a clip's name but itself, so reactions come in their clips' order.
"""

import hashlib
from collections.abc import Callable, Iterator
from pathlib import Path

from pacmo_core.interaction import Interaction, Motion
from pacmo_core.store.clips import ClipFacts
from pacmo_core.store.motions import read_skeleton, write_motions
from stages._clips import stream_side
from stages._files import MOTIONS

ROLES = ("a", "b")


def directed_clips(clips: Path, side: str) -> Iterator[tuple[str, ClipFacts, Interaction]]:
    """Yield every clip of a side twice, either person as partner: name, facts, partner first."""
    for facts, interaction in stream_side(clips, side):
        for role in ROLES:
            seen = interaction.swapped() if role == "a" else interaction
            yield f"{facts.clip}#{role}", facts, seen


def write_reactions(
    clips: Path, reactions: Path, react: Callable[[str, ClipFacts, Interaction], Motion]
) -> None:
    """Let ``react`` answer the partner of every test clip, either person once."""
    with write_motions(reactions / MOTIONS, read_skeleton(clips / MOTIONS)) as writer:
        for name, facts, seen in directed_clips(clips, "test"):
            answer = react(name, facts, seen)
            writer.add(name, Interaction(seen.skeleton, seen.times, seen.person_a, answer))


def seed_of(name: str, random_seed: int) -> int:
    """Give every reaction a seed of its own, so that another clip changes none."""
    digest = hashlib.blake2b(f"{random_seed}\0{name}".encode(), digest_size=7).digest()
    return int.from_bytes(digest)
