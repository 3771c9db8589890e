"""What it is worth to be told what touches: ``pacmo react --touch`` on SBU's partners.

Usage: python -m benchmarks.touching [--weights FILE] [--drawn N] [--json]

Of each captured pair it is taken what touches: the first that does in any frame of right hands,
left hands, any hands, a hand of one the other's body, else nothing. A user who animates knows as
much. Reactions to either person are sampled until one touches so (``told_...``), at most N, else
the first is kept; ``found`` is the share of the partners to whom one was, ``drawn`` the mean number
of reactions that were sampled, and ``untold_...`` are of the first of them. The scores, their 95 %
intervals over pairs of people and those of the difference (``..._less_untold_...``) are those of
``benchmarks.recorded``; one reaction each, so that its energy score is its APE. ``found_ACT`` is of
one act.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch

from benchmarks._figures import arguments, show
from benchmarks.recorded import counted, finished, intervals, model_at, pooled, recorded
from pacmo_core.commands.touching import TouchName, is_as_asked, touches_asked
from pacmo_core.data.interaction import Interaction, Motion
from pacmo_core.formats.sbu import Sbu
from pacmo_core.reaction.generator import Generator
from pacmo_core.reaction.inference import PACKAGED, react_all
from pacmo_core.reaction.windows import PartnerMotion

ORDER = (TouchName.right_hands, TouchName.left_hands, TouchName.hands, TouchName.body)


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
    untold: list[tuple[Interaction, Motion]] = []
    told: list[tuple[Interaction, Motion]] = []
    is_found: list[bool] = []
    n_drawn: list[int] = []
    for act, of_act in clips.acts.items():
        found_before = len(is_found)
        for clip in of_act:
            random = torch.Generator().manual_seed(len(told))
            drawn = list(until_told(model, clip, options.drawn, random))
            *_, (last, is_as_told) = drawn
            untold.append((clip, drawn[0][0]))
            told.append((clip, last if is_as_told else drawn[0][0]))
            is_found.append(is_as_told)
            n_drawn.append(len(drawn))
        figures[f"found_{act.replace(' ', '_')}"] = float(np.mean(is_found[found_before:]))
    figures |= {"found": float(np.mean(is_found)), "drawn": float(np.mean(n_drawn))}
    counts = {"untold": counted(untold), "told": counted(told)}
    for row, pairs in (("untold", untold), ("told", told)):
        rivals = {"untold": counts["untold"]} if row == "told" else {}
        found = pooled(pairs, counts[row]) | intervals(counts[row], rivals, clips.people)
        figures |= {f"{row}_{key}": value for key, value in found.items()}
    show(figures, as_json=options.json)


def captured_touch(clip: Interaction) -> TouchName:
    """Return what touches in a captured pair."""
    for name in ORDER:
        asked = touches_asked(name, clip.skeleton)
        if is_as_asked(name, asked, clip.person_a, clip.person_b):
            return name
    return TouchName.none


def until_told(
    model: Generator, clip: Interaction, most: int, random: torch.Generator
) -> Iterator[tuple[Motion, bool]]:
    """Yield reactions ``(1, T, J, 3)``, up to the first that touches as the captured pair does."""
    name = captured_touch(clip)
    asked = touches_asked(name, clip.skeleton)
    times = clip.times - clip.times[0]
    partner = PartnerMotion(clip.person_a, times, times)
    for _ in range(most):
        (made,) = react_all(model, [partner], n_samples=1, random=random)
        made = finished(model, clip, made)
        is_as_told = is_as_asked(name, asked, clip.person_a, made[0])
        yield made, is_as_told
        if is_as_told:
            return


if __name__ == "__main__":
    main()
