"""The clips of a side, with their facts."""

from collections.abc import Iterator
from pathlib import Path

from pacmo_core.interaction import Interaction
from pacmo_core.store.clips import ClipFacts, read_rows
from pacmo_core.store.motions import stream_motions
from stages._files import CLIPS, MOTIONS


def stream_side(folder: Path, side: str) -> Iterator[tuple[ClipFacts, Interaction]]:
    """Yield the clips of one side with their facts, in order."""
    facts = {row.clip: row for row in read_rows(folder / CLIPS, ClipFacts)}
    for name, interaction in stream_motions(folder / MOTIONS):
        if facts[name].side == side:
            yield facts[name], interaction
