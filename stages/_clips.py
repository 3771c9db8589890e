"""The clips of a side in a fold, with their facts."""

from collections.abc import Iterator
from pathlib import Path

from pacmo_core.data.interaction import Interaction
from pacmo_core.store.motions import stream_motions
from pacmo_core.store.tables import ClipRecord, SplitRecord, read_rows
from stages._files import CLIPS, MOTIONS


def stream_side(clips: Path, sides: Path, side: str) -> Iterator[tuple[ClipRecord, Interaction]]:
    """Yield the clips of one side with their facts, in order.

    Parameters
    ----------
    clips : folder of clips
    sides : table of the sides of one fold
    side : ``train``, ``validation`` or ``test``

    Raises
    ------
    ValueError
        If the table is of other clips.
    """
    facts = {row.clip: row for row in read_rows(clips / CLIPS, ClipRecord)}
    stands = {row.clip: row.split for row in read_rows(sides, SplitRecord)}
    if facts.keys() != stands.keys():
        odd = min(facts.keys() ^ stands.keys())
        raise ValueError(f"{sides} wanted a side for each clip of {clips}; they differ in {odd}")
    for name, interaction in stream_motions(clips / MOTIONS):
        if stands[name] == side:
            yield facts[name], interaction
