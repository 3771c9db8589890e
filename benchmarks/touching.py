"""What it is worth to be told what touches: ``pacmo react --touch`` on SBU's partners.

Usage: python -m benchmarks.touching [--weights FILE] [--drawn N] [--json]

Of each captured pair it is taken what touches: the first that does for 0.1 s of right hands, left
hands, any hands, an embrace, a hand the other's body, either's, else no hand. A user who animates
knows as much, and it is a part of what is scored. Reactions to either person are sampled until one
touches so, at most N, else the first is kept (``told_...``; ``untold_...`` are of the first).
``another`` is the same with captured reactions of clips of the act with other people, in the order
of the clips, in their place beside the partner and finished as the model's: a peer who is told the
act, and in ``another_told_...`` what touches.

``..._found`` is the share of the partners for whom one was found, ``..._drawn`` the mean number
that was looked at, ``found_ACT`` is of one act. The scores, their 95 % intervals over pairs of
people and those of differences (``told_f1_less_untold_low``) are those of ``benchmarks.recorded``;
one reaction each.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path

import numpy as np
import torch

from benchmarks._figures import arguments, show
from benchmarks._recorded import (
    counted,
    finished,
    intervals,
    model_at,
    others_reactions,
    pooled,
    recorded,
)
from pacmo_core.data.interaction import Interaction, Motion
from pacmo_core.formats.sbu import Sbu
from pacmo_core.metrics.touching import TouchName, is_as_asked
from pacmo_core.reaction.data import to_partner_frame
from pacmo_core.reaction.generator import Generator
from pacmo_core.reaction.inference import PACKAGED, react_all
from pacmo_core.reaction.windows import PartnerMotion

ORDER = tuple(name for name in TouchName if name != TouchName.no_hands)


@dataclass
class Row:
    """Reactions of one source: the first to each partner, and the first that touches as told."""

    untold: list[tuple[Interaction, Motion]] = field(default_factory=list)
    told: list[tuple[Interaction, Motion]] = field(default_factory=list)
    found: list[bool] = field(default_factory=list)
    drawn: list[int] = field(default_factory=list)

    def add(self, clip: Interaction, candidates: Iterator[Motion], name: TouchName) -> None:
        """Look at reactions ``(1, T, J, 3)`` until one touches as told."""
        looked_at: list[Motion] = []
        is_found = False
        while not is_found and (made := next(candidates, None)) is not None:
            looked_at.append(made)
            is_found = _touches(name, clip, made[0])
        self.untold.append((clip, looked_at[0]))
        self.told.append((clip, looked_at[-1 if is_found else 0]))
        self.found.append(is_found)
        self.drawn.append(len(looked_at))


def main() -> None:
    """Measure and print."""
    parser = arguments(__doc__ or "")
    parser.add_argument("--weights", type=Path, default=PACKAGED)
    parser.add_argument("--drawn", type=int, default=32, help="reactions to a partner, at most")
    options = parser.parse_args()
    torch.set_num_threads(1)
    model = model_at(options.weights, None)
    clips = recorded(model.skeleton, Sbu(fps=15))["sbu"]
    figures: dict[str, float] = {}
    ours, others = Row(), Row()
    for act, of_act in clips.acts.items():
        for number, clip in enumerate(to_partner_frame(one) for one in of_act):
            name = captured_touch(clip)
            random = torch.Generator().manual_seed(len(ours.told))
            ours.add(clip, islice(sampled(model, clip, random), options.drawn), name)
            captured = others_reactions(of_act, clips.people[act], number)
            placed = (finished(model, clip, motion[None]) for motion in captured)
            others.add(clip, islice(placed, options.drawn), name)
        of_these = ours.found[-len(of_act) :]
        figures[f"found_{act.replace(' ', '_')}"] = float(np.mean(of_these))
    rows = {
        "untold": ours.untold,
        "told": ours.told,
        "another": others.untold,
        "another_told": others.told,
    }
    counts = {name: counted(pairs) for name, pairs in rows.items()}
    for prefix, row in (("", ours), ("another_", others)):
        figures[f"{prefix}found"] = float(np.mean(row.found))
        figures[f"{prefix}drawn"] = float(np.mean(row.drawn))
    for row_name, pairs in rows.items():
        rivals = {name: of for name, of in counts.items() if name != row_name == "told"}
        scores = pooled(pairs, counts[row_name])
        scores |= intervals(counts[row_name], rivals, clips.pairs_of_people)
        figures |= {f"{row_name}_{key}": value for key, value in scores.items()}
    show(figures, as_json=options.json)


def captured_touch(clip: Interaction) -> TouchName:
    """Return what touches in a captured pair."""
    for name in ORDER:
        if _touches(name, clip, clip.person_b):
            return name
    return TouchName.no_hands


def _touches(name: TouchName, clip: Interaction, reaction: Motion) -> bool:
    return is_as_asked(name, clip.skeleton, clip.times, clip.person_a, reaction)


def sampled(model: Generator, clip: Interaction, random: torch.Generator) -> Iterator[Motion]:
    """Yield finished reactions ``(1, T, J, 3)`` of the model, without an end."""
    times = clip.times - clip.times[0]
    partner = PartnerMotion(clip.person_a, times, times)
    while True:
        (made,) = react_all(model, [partner], n_samples=1, random=random)
        yield finished(model, clip, made)


if __name__ == "__main__":
    main()
