"""Recorded partners, and weights that were not trained on them.

Usage: python -m benchmarks.recorded [--weights FILE ...] [--samples N] [--without-finish]
           [--camera-axes] [--told] [--temperature T] [--json]

Under PACMO_REAL_DATA: SBU, the couple of CMU's subjects 18 and 19, and the variations of handover,
in the joints of a model, clips of at most 14 seconds, reactions of either person. SBU has no
wrists, toes and spine: they are estimated (``rigs.ESTIMATES``) in both people; ``--camera-axes``
reads it in the axes of its camera, which looked up. With ``--told`` weights that take labels react
a second time, told the act (``told_...``): in all of SBU and handover, and in CMU's handshake. The
captured motion counts as contact where any two joints are within 10 cm.

For each model and set, pooled over its clips: ``met`` the captured frames of contact in which the
generated two are within 15 cm; ``false`` those with the captured two farther apart than 25 cm in
which they are; ``f1`` of frames within 10 cm; ``hands``, of the partners whose hands the captured
hands come within 10 cm of, the share of reactions in which hands do so too, and ``false_hands`` of
the others; ``energy_score`` and ``ape`` in metres, of the mean distance of joints. One reaction, as
of a regression, has no spread: its energy score is its ape. ``SET_permuted_...`` are the same of
the captured reaction of the next clip of the same act with other people (CMU and handover have one
couple and one act each: the next clip), in its place beside that partner: somebody who does what
the act wants and does not see whom with;
``SET_permuted_finished_...`` the same, finished as the reactions of the first model.
``SET_handshake_to_a`` and ``..._b`` are, of eight reactions to one person of each handshake (CMU's
is 18_01), the share in which right hands come within 10 cm, and ``SET_handshake_usual_to_a`` the
same of the one of each eight that is most like the others. ``SET_gives_way`` is in metres, of the
reactions to partners from whose push, kick or punch the captured person gives way by more than 15
cm: how far the body moves away from its nearest place to the partner, as its first frame sees the
partner; ``SET_gives_way_captured`` is that of the captured people.

Of SBU, ``..._met_low`` and ``..._met_high`` (and so of the others but ``ape``) are the 95 %
interval, which resamples its pairs of people, and ``..._met_less_permuted_finished_low`` and so on
that of the difference from somebody who does what the act wants; of further weights, and of those
that were told the act, ``..._met_less_first_low`` and so on that from the first. The people are few
and meet in several pairs: intervals are rough.

Handover states the giver's floor 20 cm too low; both people are lowered alike, as hands would miss
each other else.
"""

from collections.abc import Mapping
from itertools import product
from pathlib import Path

import torch

from benchmarks._figures import arguments, show
from benchmarks._recorded import (
    Counts,
    Recorded,
    counted,
    finished,
    intervals,
    mean_way,
    model_at,
    most_usual,
    permuted,
    pooled,
    react_to,
    recorded,
    right_hands,
)
from pacmo_core.formats.sbu import Sbu
from pacmo_core.reaction.generator import Generator
from pacmo_core.reaction.inference import PACKAGED

HANDSHAKE = "shake hands"
# Words of the default's label that names an act of SBU, or of a set.
LABELS = {
    "approaching": "walk towards",
    "departing": "walk apart",
    "kicking": "kick",
    "pushing": "push",
    "shaking hands": HANDSHAKE,
    "hugging": "hug",
    "exchanging": "give",
    "punching": "punch",
    "handover": "give",
}


def main() -> None:
    """Measure and print."""
    parser = arguments(__doc__ or "")
    parser.add_argument("--weights", type=Path, nargs="+", default=[PACKAGED])
    parser.add_argument("--samples", type=int, default=2, help="reactions to each partner")
    parser.add_argument("--without-finish", action="store_true")
    parser.add_argument("--camera-axes", action="store_true", help="of SBU, not the floor's")
    parser.add_argument("--told", action="store_true", help="react a second time, told the act")
    parser.add_argument("--temperature", type=float, help="of the noise; the model's by default")
    options = parser.parse_args()
    torch.set_num_threads(1)
    sbu = Sbu(fps=15, camera_pitch=0) if options.camera_axes else Sbu(fps=15)
    finish = not options.without_finish
    figures: dict[str, float] = {}
    rivals: dict[str, dict[str, Counts]] = {}  # of each set
    for number, path in enumerate(options.weights):
        model = model_at(path, options.temperature)
        prefix = f"{number + 1}_" if len(options.weights) > 1 else ""
        ways = {"": {}, "told_": LABELS} if options.told and model.config.actions else {"": {}}
        for (name, clips), (way, labels) in product(
            recorded(model.skeleton, sbu).items(), ways.items()
        ):
            found = reactions_to_some(model, clips, finish, labels)
            pairs = [
                pair
                for act, of_act in clips.acts.items()
                for pair in react_to(model, of_act, options.samples, finish, labels.get(act, ""))
            ]
            counts = counted(pairs)
            found |= pooled(pairs, counts)
            if name not in rivals:
                others, rivals[name] = permuted_rows(model, clips)
                figures |= {f"{name}_{key}": value for key, value in others.items()}
            if name == "sbu":
                found |= intervals(counts, rivals[name], clips.pairs_of_people)
            rivals[name].setdefault("first", counts)
            figures |= {f"{prefix}{way}{name}_{key}": value for key, value in found.items()}
    show(figures, as_json=options.json)


def reactions_to_some(
    model: Generator, clips: Recorded, finish: bool, labels: Mapping[str, str]
) -> dict[str, float]:
    """Return how far blows are given way to, in two samples, and how often hands are shaken."""
    found = {}
    if any(clips.blows.values()):
        made = [
            pair
            for act, of_act in clips.blows.items()
            for pair in react_to(model, of_act, 2, finish, labels.get(act, ""))
        ]
        found["gives_way"] = mean_way(made)
        found["gives_way_captured"] = mean_way([(c, c.person_b[None]) for c, _ in made])
    if clips.handshakes:
        label = HANDSHAKE if labels else ""
        shaken = react_to(model, clips.handshakes, 8, finish, label)
        half = len(shaken) // 2
        for person, pairs in (("a", shaken[:half]), ("b", shaken[half:])):
            found[f"handshake_to_{person}"] = right_hands(pairs)
            usual = [(clip, motions[[most_usual(motions)]]) for clip, motions in pairs]
            found[f"handshake_usual_to_{person}"] = right_hands(usual)
    return found


def permuted_rows(model: Generator, clips: Recorded) -> tuple[dict[str, float], dict[str, Counts]]:
    """Score others' captured reactions, as they are and finished, and count the latter's frames."""
    others = [
        pair for act, of_act in clips.acts.items() for pair in permuted(of_act, clips.people[act])
    ]
    rows = {
        "permuted": others,
        "permuted_finished": [(clip, finished(model, clip, motions)) for clip, motions in others],
    }
    counts = {row: counted(pairs) for row, pairs in rows.items()}
    scores = {
        f"{row}_{key}": value
        for row, pairs in rows.items()
        for key, value in pooled(pairs, counts[row]).items()
    }
    return scores, {"permuted_finished": counts["permuted_finished"]}


if __name__ == "__main__":
    main()
