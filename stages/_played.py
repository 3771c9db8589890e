"""Which clips the page plays: the best, the median and the worst answer, then one of each act."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.names import ReactionName, direction_of
from pacmo_core.figures.clips import Panel, PlayedClip
from pacmo_core.store.motions import stream_motions
from stages._files import MOTIONS
from stages._reactions import directed_clips

JUDGED = "pacmo"  # whose answers say which clips are best and worst


def played(folders: tuple[Path, Path], reactions: dict[str, str], n_clips: int) -> list[PlayedClip]:
    """Choose test clips, and set what answered beside the captured reaction."""
    clips = {
        name: (facts.action, seen)
        for name, facts, seen in directed_clips(*folders, "test")
        if direction_of(name) == "b"
    }
    answers = {row: answers_in(Path(folder)) for row, folder in reactions.items()}
    judged = answers.get(JUDGED, {})
    errors = {n: error(seen, judged[n]) for n, (_, seen) in clips.items() if n in judged}
    remarks = extremes(errors)
    first = list(remarks) + [name for name in in_turn(clips) if name not in remarks]
    return [
        PlayedClip(
            name,
            clips[name][0],
            (
                Panel("real", clips[name][1]),
                *(Panel(row, found[name]) for row, found in answers.items() if name in found),
            ),
            remarks.get(name, ""),
        )
        for name in first[:n_clips]
    ]


def error(seen: Interaction, answer: Interaction) -> float:
    """Metres between joints of the captured and the generated reaction, on average."""
    apart = np.linalg.norm(seen.person_b - answer.person_b, axis=-1)
    return float(apart.mean(dtype=np.float64))


def extremes(errors: dict[str, float]) -> dict[str, str]:
    """Name the clips answered best, worst and as usual, and say how well."""
    order = sorted(errors, key=lambda name: (errors[name], name))
    if not order:
        return {}
    places = {"Best": 0, "Median": (len(order) - 1) // 2, "Worst": len(order) - 1}
    told: dict[str, str] = {}
    for word, place in places.items():
        name = order[place]
        told.setdefault(
            name,
            f"{word} of {len(order)} answers of {JUDGED}: joints {errors[name]:.3f} m from the "
            "captured reaction on average, which is one of many that would do.",
        )
    return told


def in_turn(clips: dict[str, tuple[str, Interaction]]) -> Iterator[str]:
    """List the clips, one an action before a second of any."""
    turn: dict[str, int] = {}
    order = []
    for name, (action, _) in clips.items():
        turn[action] = turn.get(action, -1) + 1
        order.append((turn[action], name))
    yield from (name for _, name in sorted(order))


def answers_in(folder: Path) -> dict[str, Interaction]:
    """Hold the first reactions of one row, by clip and person."""
    found = ((ReactionName.parse(name), i) for name, i in stream_motions(folder / MOTIONS))
    return {name.directed: interaction for name, interaction in found if name.sample == 0}
