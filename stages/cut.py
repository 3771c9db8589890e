"""Cut sequences into clips.

Usage: python -m stages.cut SEQUENCES CLIPS
"""

import sys
from dataclasses import dataclass, replace
from pathlib import Path

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.names import clip_name
from pacmo_core.data.splits import window_edges
from pacmo_core.store.motions import read_skeleton, stream_motions, write_motions
from pacmo_core.store.tables import ClipRecord, read_rows, write_rows
from stages.common.files import CLIPS, MOTIONS
from stages.common.params import read_params


@dataclass(frozen=True)
class Params:
    """The ``cut`` section of ``params.yaml``."""

    clip_seconds: float  # recordings much longer than this are cut into windows of about this


def main(sequences: Path, clips: Path) -> None:
    params = read_params("cut", Params)
    facts = {row.sequence: row for row in read_rows(sequences / CLIPS, ClipRecord)}
    rows = []
    with write_motions(clips / MOTIONS, read_skeleton(sequences / MOTIONS)) as writer:
        for name, sequence in stream_motions(sequences / MOTIONS):
            for row, clip in cut(facts[name], sequence, params.clip_seconds):
                writer.add(row.clip, clip)
                rows.append(row)
    write_rows(clips / CLIPS, ClipRecord, rows)


def cut(
    facts: ClipRecord, sequence: Interaction, seconds: float
) -> list[tuple[ClipRecord, Interaction]]:
    """Cut one sequence; one that stays whole keeps its name.

    ``#`` sorts before every character of a sequence's name, so clips come in their names' order.
    """
    edges = window_edges(len(sequence.times), sequence.fps, seconds)
    clips = []
    for number, (start, stop) in enumerate(edges):
        name = clip_name(facts.sequence, number, len(edges))
        clip = sequence.frames(start, stop)
        row = replace(
            facts, clip=name, duration=clip.duration, frames=stop - start, start_frame=start
        )
        clips.append((row, clip))
    return clips


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
