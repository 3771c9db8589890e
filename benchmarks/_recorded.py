"""Recorded partners: the sets, reactions to them, and their scores, for several benchmarks."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from benchmarks._captures import BVH, real_data
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
from pacmo_core.reaction.inference import finish_reactions, react_all
from pacmo_core.reaction.windows import PartnerMotion, is_deterministic

CONTACT, MET, APART = 0.1, 0.15, 0.25  # metres
MAX_SECONDS = 14.0
CMU_HANDSHAKE = "18_19/18_01"
BLOWS = ("pushing", "kicking", "punching")
GIVES_WAY = 0.15  # metres
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


def model_at(path: Path, temperature: float | None) -> Generator:
    """Read a model, with another temperature of its noise if one is given."""
    model = model_of(path)
    if temperature is not None:
        model.temperature.fill_(temperature)
    return model


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


def most_usual(motions: Motion) -> int:
    """Return the number of the sample whose joints are nearest to those of all others."""
    apart = [np.linalg.norm(motions - one, axis=-1).mean() for one in motions]
    return int(np.argmin(apart))
