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

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from benchmarks._captures import BVH, real_data
from benchmarks._figures import arguments, show
from benchmarks.invariance import model_of
from pacmo_core.data.interaction import Interaction, Motion, min_point_distance
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.formats.base import Format, FormatError
from pacmo_core.formats.joint_names import StatedNames, name_joints
from pacmo_core.formats.sbu import Sbu
from pacmo_core.formats.table import Table
from pacmo_core.metrics.contact import contact_f1, contacts_met, false_contacts
from pacmo_core.reaction.data import expand_directions, replace_reaction, to_partner_frame
from pacmo_core.reaction.generator import Generator
from pacmo_core.reaction.inference import PACKAGED, finish_reactions, react_all
from pacmo_core.reaction.windows import PartnerMotion, is_deterministic

CONTACT, MET, APART = 0.1, 0.15, 0.25  # metres
MAX_SECONDS = 14.0
CMU_HANDSHAKE = "18_19/18_01"
BLOWS = ("pushing", "kicking", "punching")
GIVES_WAY = 0.15  # metres
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
N_REPLICATES = 2000  # of the bootstrap over pairs of people

Array = NDArray[np.float64]
Counts = dict[str, Array]  # (2, clips): a sum over each clip, and the number it is a share of


@dataclass(frozen=True)
class Recorded:
    """A set: the clips of each act, its handshakes and its blows; either person as the partner.

    ``people`` are the pair of people of each clip.
    """

    acts: dict[str, list[Interaction]]
    people: dict[str, list[str]]
    handshakes: list[Interaction]
    blows: dict[str, list[Interaction]]

    @property
    def pairs_of_people(self) -> list[str]:
        """The pair of people of each clip, of all acts in turn."""
        return [pair for of_act in self.people.values() for pair in of_act]


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


def model_at(path: Path, temperature: float | None) -> Generator:
    """Read a model, with another temperature of its noise if one is given."""
    model = model_of(path)
    if temperature is not None:
        model.temperature.fill_(temperature)
    return model


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
            usual = [(clip, motions[[_usual(motions)]]) for clip, motions in pairs]
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


def recorded(skeleton: Skeleton, sbu: Sbu) -> dict[str, Recorded]:
    """Read the sets."""
    root = real_data()
    readers: dict[str, tuple[Format, str, str]] = {
        "sbu": (sbu, "sbu", "*"),
        "cmu": (replace(BVH, preset="cmu_18_19", max_root_distance=None), "cmu_18_19", "18_19/*"),
        "handover": (Table(), "handover", "variation_*"),
    }
    sets: dict[str, Recorded] = {}
    for name, (form, folder, pattern) in readers.items():
        acts: dict[str, list[Interaction]] = {}
        handshakes: list[Interaction] = []
        people: dict[str, list[str]] = {}
        for sequence in form.find(root / folder) if (root / folder).is_dir() else ():
            if not Path(sequence.name).match(pattern):
                continue
            try:
                clip = form.read(sequence).interaction
            except FormatError:  # a take of one person
                continue
            if clip.duration <= MAX_SECONDS:
                act = sequence.action if name == "sbu" else name
                acts.setdefault(act, []).append(on_floor(in_joints(clip, skeleton)))
                people.setdefault(act, []).append(pair_of_people(sequence.name))
                if act == "shaking hands" or sequence.name == CMU_HANDSHAKE:
                    handshakes.append(acts[act][-1])
        if acts:
            both = {act: expand_directions(clips, both=True) for act, clips in acts.items()}
            shaken = expand_directions(handshakes, both=True)
            blows = {act: [clip for clip in both[act] if is_given_way(clip)]
                     for act in BLOWS if act in both}  # fmt: skip
            of_clips = {act: 2 * pairs for act, pairs in people.items()}
            sets[name] = Recorded(both, of_clips, shaken, blows)
    return sets


def pair_of_people(name: str) -> str:
    """Return ``s02s03`` of SBU's ``s03s02/01/001``, whoever is first."""
    folder = name.partition("/")[0]
    return "".join(sorted([folder[:3], folder[3:]]))


def in_joints(clip: Interaction, skeleton: Skeleton) -> Interaction:
    """Express both people in the joints of a model."""
    rig = "zed34" if "naval_spine" in clip.skeleton.joints else ""
    names = name_joints(clip.skeleton, skeleton, StatedNames(rig), estimates=True)
    people = [names.apply(clip.person_a), names.apply(clip.person_b)]
    return replace(clip, skeleton=skeleton, person_a=people[0], person_b=people[1])


def on_floor(clip: Interaction) -> Interaction:
    """Lower both people alike, so that the lower one stands at height 0, but for noise."""
    lowest = [motion[..., 1].min(axis=1) for motion in (clip.person_a, clip.person_b)]
    floor = np.array([0, np.quantile(lowest, 0.2), 0], np.float32)
    return replace(clip, person_a=clip.person_a - floor, person_b=clip.person_b - floor)


def react_to(
    model: Generator,
    partners: Sequence[Interaction],
    n_samples: int,
    finish: bool,
    action: str = "",
) -> list[tuple[Interaction, Motion]]:
    """Return each captured interaction with reactions to its ``person_a``, (S, T, J, 3)."""
    random, pairs = torch.Generator().manual_seed(1), []
    n_samples = 1 if is_deterministic(model) else n_samples
    for clip in partners:
        times = clip.times - clip.times[0]
        partner = PartnerMotion(clip.person_a, times, times, action)
        (reactions,) = react_all(model, [partner], n_samples=n_samples, random=random)
        pairs.append((clip, finished(model, clip, reactions) if finish else reactions))
    return pairs


def finished(model: Generator, clip: Interaction, reactions: Motion) -> Motion:
    """Finish reactions ``(S, T, J, 3)`` to the ``person_a`` of a clip."""
    times = clip.times - clip.times[0]
    return finish_reactions(model, PartnerMotion(clip.person_a, times, times), reactions)


def permuted(
    partners: Sequence[Interaction], people: Sequence[str]
) -> Iterator[tuple[Interaction, Motion]]:
    """Give each partner the captured reaction to the next one of the same act with other people."""
    for number, clip in enumerate(partners):
        here = to_partner_frame(clip)
        yield here, next(others_reactions(partners, people, number))[None]


def others_reactions(
    partners: Sequence[Interaction], people: Sequence[str], number: int
) -> Iterator[Motion]:
    """Yield the captured reactions of further clips of an act, in their place beside a partner.

    Of other people, where the act has some: the next clip is most often of the same two.

    Parameters
    ----------
    partners : of one act; the second half are the first with people exchanged, and stay apart
    people : the pair of people of each
    number : of the partner
    """
    here, half = to_partner_frame(partners[number]), len(partners) // 2
    first = half * (number >= half)
    further = [first + (number - first + step) % half for step in range(1, half)]
    others = [other for other in further if people[other] != people[number]]
    for other in others or further:
        yield replace_reaction(here, to_partner_frame(partners[other])).person_b


def pooled(pairs: Sequence[tuple[Interaction, Motion]], counts: Counts) -> dict[str, float]:
    """Score reactions ``(S, T, J, 3)`` to the partners of captured interactions, over all."""
    return {
        **{name: float(sums.sum() / of.sum()) for name, (sums, of) in counts.items() if of.any()},
        "ape": float(
            np.mean([_distance(c.person_b, motion) for c, made in pairs for motion in made])
        ),
        "reactions": sum(len(made) for _, made in pairs),
    }


def counted(pairs: Sequence[tuple[Interaction, Motion]]) -> Counts:
    """Sum what is scored over each clip: frames of ``met``, ``false`` and ``f1``, hands, scores."""
    counts: dict[str, list[Array]] = {}
    for clip, reactions in pairs:
        made = [min_point_distance(clip.person_a, motion) for motion in reactions]
        real = [min_point_distance(clip.person_a, clip.person_b)] * len(made)
        should_meet = _hands_meet(clip, clip.person_b)
        meeting = sum(_hands_meet(clip, motion) for motion in reactions)
        of_hands = np.array([meeting, len(made)], np.float64)
        found: dict[str, Array] = {
            "met": contacts_met(made, real, contact=CONTACT, met=MET).sum(axis=1),
            "false": false_contacts(made, real, apart=APART, met=MET).sum(axis=1),
            "f1": contact_f1(made, real, distance=CONTACT).sum(axis=1),
            "hands": should_meet * of_hands,
            "false_hands": (not should_meet) * of_hands,
            "energy_score": np.array([_energy_score(clip.person_b, reactions), 1.0]),
        }
        for name, value in found.items():
            counts.setdefault(name, []).append(value)
    return {name: np.stack(found, axis=1) for name, found in counts.items()}


def intervals(row: Counts, rivals: dict[str, Counts], people: Sequence[str]) -> dict[str, float]:
    """Return 95 % intervals over pairs of people: of a row, and of its difference from rivals.

    Parameters
    ----------
    row, rivals : what ``counted`` returns, of the same clips
    people : the pair of people of each clip
    """
    pairs, of_clip = np.unique(people, return_inverse=True)
    random = np.random.default_rng(0)
    drawn = random.multinomial(len(pairs), np.full(len(pairs), 1 / len(pairs)), N_REPLICATES)
    weights = drawn[:, of_clip]  # of each clip in each replicate

    def shares(counts: Array) -> Array:
        hits, of = counts @ weights.T
        return np.asarray((hits / np.maximum(of, 1e-9))[of > 0])

    found: dict[str, float] = {}
    for name, counts in row.items():
        spread = {name: shares(counts)}
        spread |= {
            f"{name}_less_{rival}": spread[name] - shares(theirs[name])
            for rival, theirs in rivals.items()
        }
        for key, values in spread.items():
            if not len(values):  # no clip has what is counted
                continue
            low, high = np.quantile(values, (0.025, 0.975))
            found |= {f"{key}_low": float(low), f"{key}_high": float(high)}
    return found


def _usual(motions: Motion) -> int:
    """Return the number of the sample whose joints are nearest to those of all others."""
    apart = [np.linalg.norm(motions - one, axis=-1).mean() for one in motions]
    return int(np.argmin(apart))


def right_hands(pairs: Sequence[tuple[Interaction, Motion]]) -> float:
    """Return the share of reactions whose right hand comes near the partner's."""
    gaps = []
    for clip, reactions in pairs:
        hand = clip.skeleton.joints.index("right_hand")
        gap = np.linalg.norm(reactions[..., hand, :] - clip.person_a[:, hand], axis=-1)
        gaps += gap.min(axis=-1).tolist()
    return float((np.array(gaps) <= CONTACT).mean())


def _way(partner: Motion, person: Motion) -> float:
    """Metres from the place of a body that is nearest to the partner to where it ends."""
    across = (person[:, 0] - partner[:, 0])[0] * [1, 0, 1]
    along = person[:, 0] @ (across / np.linalg.norm(across))
    return float(along[-max(len(along) // 6, 2) :].mean() - along.min())


def is_given_way(clip: Interaction) -> bool:
    """Return whether the captured person gives way to the partner."""
    return _way(clip.person_a, clip.person_b) > GIVES_WAY


def mean_way(pairs: Sequence[tuple[Interaction, Motion]]) -> float:
    """Return by how many metres reactions ``(S, T, J, 3)`` to blows give way on average."""
    ways = [_way(clip.person_a, motion) for clip, reactions in pairs for motion in reactions]
    return float(np.mean(ways))


def _hands_meet(clip: Interaction, person: Motion) -> bool:
    hands = [clip.skeleton.joints.index(f"{side}_hand") for side in ("left", "right")]
    gap = min_point_distance(clip.person_a[:, hands], person[:, hands])
    return bool(gap.min() <= CONTACT)


def _energy_score(captured: Motion, reactions: Motion) -> float:
    pairs = [_distance(a, b) for n, a in enumerate(reactions) for b in reactions[:n]]
    spread = float(np.mean(pairs)) if pairs else 0.0
    return float(np.mean([_distance(captured, motion) for motion in reactions])) - spread / 2


def _distance(first: Motion, second: Motion) -> float:
    return float(np.linalg.norm(first - second, axis=-1).mean())


if __name__ == "__main__":
    main()
