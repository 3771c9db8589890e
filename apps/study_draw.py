"""What a study shows, and to whom: blind, balanced, no clip twice in two forms to one person."""

import json
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.names import ReactionName
from pacmo_core.figures.scenes import Scene, packed_scenes
from pacmo_core.project.workspace import MOTIONS, CommandError
from pacmo_core.store.motions import read_motion, stream_motions
from pacmo_core.store.study import GENERATED, REAL, Candidate, Item


def draw_items(
    clips: Path, reactions: Path, count: int, random: np.random.Generator
) -> Iterator[Item]:
    """Draw captured clips that a model answered, and beside each its first answer.

    Raises
    ------
    CommandError
        If the model answered too few.
    """
    named = ((ReactionName.parse(n), motion) for n, motion in stream_motions(reactions / MOTIONS))
    answered = {name: motion for name, motion in named if name.sample == 0}
    sources = sorted({name.clip for name in answered})
    if len(sources) < count:
        raise CommandError(f"{reactions}: wanted answers to {count} clips; got {len(sources)}")
    for source in random.choice(np.array(sources), count, replace=False).tolist():
        names = [name for name in answered if name.clip == source]
        name = names[int(random.integers(len(names)))]
        reaction = answered[name].swapped() if name.direction == "a" else answered[name]
        yield _item(REAL, source, read_motion(clips / MOTIONS, source))
        yield _item(GENERATED, source, reaction)


def _item(kind: str, source: str, shown: Interaction) -> Item:
    """Pack a clip without a word of what it is."""
    return Item(kind, source, json.dumps(packed_scenes([Scene.of("", shown)], contact=0.0)))


def balanced(candidates: Sequence[Candidate], count: int, random: np.random.Generator) -> list[int]:
    """Choose half of each kind, those least shown first, each source once, in random order.

    Parameters
    ----------
    count : how many; of an odd one, chance says which kind has one more

    Raises
    ------
    ValueError
        If there are too few sources.
    """
    order = random.permutation(len(candidates))
    waiting = sorted((candidates[k] for k in order), key=lambda c: c.times_shown)
    wanted = {REAL: count // 2, GENERATED: count // 2}
    wanted[(REAL, GENERATED)[int(random.integers(2))]] += count % 2
    chosen: list[int] = []
    sources: set[str] = set()
    for kind in random.permutation(np.array([REAL, GENERATED])).tolist():
        fitting = [c for c in waiting if c.kind == kind and c.source not in sources]
        if len(fitting) < wanted[kind]:
            raise ValueError(f"a participant wants {count} sources; the study has fewer")
        chosen += [c.item for c in fitting[: wanted[kind]]]
        sources |= {c.source for c in fitting[: wanted[kind]]}
    return [chosen[k] for k in random.permutation(len(chosen))]
