"""Cut sequences into clips and put every clip on a side.

Usage: python -m stages.split SEQUENCES CLIPS METRICS.json
"""

import sys
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

from pacmo_core.interaction import Interaction
from pacmo_core.split import Origin, Side, SideRule, assign_sides, resolve_method, window_edges
from pacmo_core.store.clips import ClipFacts, read_rows, write_rows
from pacmo_core.store.motions import read_skeleton, stream_motions, write_motions
from stages._files import CLIPS, MOTIONS, write_json
from stages._params import read_params


@dataclass(frozen=True)
class Params:
    """The ``split`` section of ``params.yaml``."""

    clip_seconds: float  # recordings much longer than this are cut into windows of about this
    sides: SideRule


def main(sequences: Path, clips: Path, metrics: Path) -> None:
    params = read_params("split", Params)
    facts = {row.sequence: row for row in read_rows(sequences / CLIPS, ClipFacts)}
    rows = []
    with write_motions(clips / MOTIONS, read_skeleton(sequences / MOTIONS)) as writer:
        for name, sequence in stream_motions(sequences / MOTIONS):
            for row, clip in cut(facts[name], sequence, params.clip_seconds):
                writer.add(row.clip, clip)
                rows.append(row)

    origins = [Origin(row.clip, row.recording, people(row)) for row in rows]
    sides = assign_sides(origins, params.sides)
    write_rows(clips / CLIPS, ClipFacts, [replace(row, side=sides[row.clip]) for row in rows])
    write_json(metrics, summary(origins, sides, params.sides))


def cut(
    facts: ClipFacts, sequence: Interaction, seconds: float
) -> list[tuple[ClipFacts, Interaction]]:
    """Cut one sequence; one that stays whole keeps its name.

    ``#`` sorts before every character of a sequence's name, so clips come in their names' order.
    """
    edges = window_edges(len(sequence.times), sequence.fps, seconds)
    clips = []
    for number, (start, stop) in enumerate(edges):
        name = facts.sequence if len(edges) == 1 else f"{facts.sequence}#{number:04d}"
        clip = sequence.frames(start, stop)
        row = replace(
            facts, clip=name, duration=clip.duration, frames=stop - start, start_frame=start
        )
        clips.append((row, clip))
    return clips


def people(row: ClipFacts) -> tuple[str, ...]:
    """Name the people of a clip that its data set names."""
    return tuple(person for person in (row.subject_a, row.subject_b) if person)


def summary(origins: list[Origin], sides: dict[str, Side], rule: SideRule) -> dict[str, object]:
    """Say how the clips were put on sides."""
    counts = Counter(sides.values())
    return {
        "clips": len(origins),
        "method": resolve_method(origins, rule),
        "people": len({person for origin in origins for person in origin.people}),
        **{side: counts[side] for side in ("train", "validation", "test", "dropped")},
    }


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
