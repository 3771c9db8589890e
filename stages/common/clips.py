"""The clips of a split in a fold, with their records."""

import hashlib
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from pacmo_core.data.interaction import Interaction, Motion
from pacmo_core.data.names import DIRECTIONS, MAX_SAMPLES, directed_name, sample_name
from pacmo_core.data.splits import ClipOrigin
from pacmo_core.store.motions import read_skeleton, stream_motions, write_motions
from pacmo_core.store.tables import ClipRecord, SplitRecord, read_rows
from stages.common.files import CLIPS, MOTIONS


def clip_origin(row: ClipRecord) -> ClipOrigin:
    """Return what a clip may have in common with others: recording and people, as far as named."""
    people = tuple(person for person in (row.subject_a, row.subject_b) if person)
    return ClipOrigin(row.clip, row.recording, people)


def stream_split(clips: Path, splits: Path, split: str) -> Iterator[tuple[ClipRecord, Interaction]]:
    """Yield the clips of one split with their records, in order.

    Parameters
    ----------
    clips : folder of clips
    splits : file of the splits of one fold
    split : ``train``, ``validation`` or ``test``

    Raises
    ------
    ValueError
        If the splits are of other clips.
    """
    facts = {row.clip: row for row in read_rows(clips / CLIPS, ClipRecord)}
    split_of_clip = {row.clip: row.split for row in read_rows(splits, SplitRecord)}
    if facts.keys() != split_of_clip.keys():
        differing = min(facts.keys() ^ split_of_clip.keys())
        raise ValueError(
            f"{splits}: wanted a split for each clip of {clips}; they differ in {differing}"
        )
    for name, interaction in stream_motions(clips / MOTIONS):
        if split_of_clip[name] == split:
            yield facts[name], interaction


def directed_clips(
    clips: Path, splits: Path, split: str
) -> Iterator[tuple[str, ClipRecord, Interaction]]:
    """Yield every clip of a split in both directions: name, record, clip with the partner as a.

    The name is that of the clip, ``#`` and the person who reacts.
    """
    for facts, interaction in stream_split(clips, splits, split):
        for direction in DIRECTIONS:
            directed = interaction.swapped() if direction == "a" else interaction
            yield directed_name(facts.clip, direction), facts, directed


def write_reactions(
    clips: Path,
    splits: Path,
    reactions: Path,
    react: Callable[[str, ClipRecord, Interaction], Iterable[Motion]],
) -> None:
    """Write the reactions that ``react`` generates to each person of every test clip.

    Raises
    ------
    ValueError
        If there are more than ten reactions to a partner.
    """
    with write_motions(reactions / MOTIONS, read_skeleton(clips / MOTIONS)) as writer:
        for name, facts, directed in directed_clips(clips, splits, "test"):
            for number, reaction in enumerate(react(name, facts, directed)):
                if number == MAX_SAMPLES:
                    raise ValueError(f"{name}: wanted at most {MAX_SAMPLES} reactions, got more")
                both = Interaction(directed.skeleton, directed.times, directed.person_a, reaction)
                writer.add(sample_name(name, number), both)


def clip_seed(name: str, random_seed: int) -> int:
    """Return a seed that depends on the name alone, so that no clip changes another's reaction."""
    digest = hashlib.blake2b(f"{random_seed}\0{name}".encode(), digest_size=7).digest()
    return int.from_bytes(digest)
