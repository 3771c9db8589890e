"""Fine-tuning on a few captures: the weights before and after, on clips that neither has seen.

Usage: ./run repro sbu_finetuned, then
       python -m benchmarks.finetuned [--also NAME=MODELS ...] [--samples N] [--json]

In the project, after a run of ``experiments/sbu_finetuned.yaml`` or of one's own: the test clips of
every fold, either person as the partner, pooled. Rows:

- ``before``: the weights that the training continued from (``train_pacmo.start``);
- ``tuned``: ``models/FOLD/pacmo/1``, and each NAME of a folder ``MODELS/FOLD/pacmo/1``, such as one
  of a training from random weights;
- ``nearest``: the reactions of the N nearest training partners of the fold; ``another``: N training
  reactions in the same act and role, drawn at random, by somebody who knows the act and does not
  see whom with. Both are finished as ``before``. Clips of acts without a training clip are left
  out of all rows.

N reactions to each partner in every row, as the energy score counts spread. Scores are those of
``benchmarks.recorded``, with 95 % intervals over pairs of people, or recordings where nobody is
named (``tuned_f1_low``), and those of differences (``tuned_f1_less_before_low``,
``..._less_nearest_low``, ``..._less_another_low``): they hold neither draws nor trainings.
``ROW_handshake`` is the share of reactions in SBU's handshakes whose right hand comes within 10 cm
of the partner's, ``ROW_gives_way`` how far, in metres, reactions to blows give way where the
captured person does.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

import numpy as np
import torch
from ruamel.yaml import YAML

from benchmarks._figures import arguments, show
from benchmarks._recorded import (
    BLOWS,
    Counts,
    counted,
    finished,
    intervals,
    is_given_way,
    mean_way,
    model_at,
    on_floor,
    pooled,
    react_to,
    right_hands,
)
from pacmo_core.data.interaction import Interaction, Motion
from pacmo_core.metrics.untrained import TrainingReactions
from pacmo_core.reaction.data import expand_directions, replace_reaction, to_partner_frame
from pacmo_core.reaction.generator import Generator
from pacmo_core.store.motions import MotionReader
from pacmo_core.store.tables import ClipRecord, SplitRecord, read_rows

CLIPS = Path("data/clips")
PEERS = ("before", "nearest", "another")
N_POINTS = 33  # at which training partners are compared

Pairs = list[tuple[Interaction, Motion]]  # reactions (S, T, J, 3), metres, to the person_a of each


@dataclass(frozen=True)
class Fold:
    """Clips of a fold, by act. Of test clips the second half are the first with people exchanged.

    Parameters
    ----------
    number : of the fold
    acts : test clips, of acts that are trained on
    people : the pair of people, or the recording, of each of them
    train : training clips, ``person_a`` the partner
    """

    number: int
    acts: dict[str, list[Interaction]]
    people: dict[str, list[str]]
    train: dict[str, list[Interaction]]


def main() -> None:
    """Measure and print."""
    parser = arguments(__doc__ or "")
    parser.add_argument("--also", nargs="+", default=[], metavar="NAME=MODELS")
    parser.add_argument("--samples", type=int, default=8, help="reactions to each partner")
    options = parser.parse_args()
    torch.set_num_threads(1)
    params = YAML(typ="safe").load(Path("params.yaml"))
    folds = [read_fold(number) for number in params["runs"]["folds"]]
    before = model_at(Path(params["train_pacmo"]["start"]["weights"]), None)
    folders = {"tuned": Path("models")}
    folders |= {name: Path(models) for name, _, models in (w.partition("=") for w in options.also)}
    if own := set(folders) & set(PEERS):
        parser.error(f"--also: wanted other names than {', '.join(sorted(own))}")
    rows: dict[str, Callable[[Fold, str], Pairs]] = {
        "before": lambda fold, act: react_to(before, fold.acts[act], options.samples, finish=True),
        "nearest": partial(nearest, before, options.samples),
        "another": partial(another, before, options.samples),
        **{name: partial(trained, of, options.samples) for name, of in folders.items()},
    }
    figures: dict[str, float] = {}
    peers: dict[str, Counts] = {}
    for name, react in rows.items():
        by_act = [(act, react(fold, act)) for fold in folds for act in fold.acts]
        counts = counted([pair for _, pairs in by_act for pair in pairs])
        people = [pair for fold in folds for act in fold.acts for pair in fold.people[act]]
        found = scores(by_act, counts) | intervals(counts, peers, people)
        if name in PEERS:
            peers[name] = counts
        figures |= {f"{name}_{key}": value for key, value in found.items()}
    show(figures, as_json=options.json)


@cache
def _model_of(weights: Path) -> Generator:
    return model_at(weights, None)


def read_fold(number: int) -> Fold:
    """Read the test and the training clips of a fold.

    Raises
    ------
    SystemExit
        If no test clip is of an act that was trained on.
    """
    facts = {row.clip: row for row in read_rows(CLIPS / "clips.parquet", ClipRecord)}
    read = MotionReader(CLIPS / "motions.parquet").read
    splits = Path(f"data/splits/{number}.parquet")
    of: dict[str, dict[str, list[str]]] = {"train": {}, "test": {}}  # names by split and act
    for row in read_rows(splits, SplitRecord):
        if row.split in of:
            of[row.split].setdefault(facts[row.clip].action, []).append(row.clip)
    tested = {act: names for act, names in of["test"].items() if act in of["train"]}
    if not tested:
        raise SystemExit(
            f"{splits}: wanted test clips of an act that is trained on; there are none"
        )

    def motions(acts: Mapping[str, list[str]]) -> dict[str, list[Interaction]]:
        return {act: [on_floor(read(name)) for name in names] for act, names in acts.items()}

    both = {act: expand_directions(clips, both=True) for act, clips in motions(tested).items()}
    people = {act: 2 * [unit_of(facts[name]) for name in names] for act, names in tested.items()}
    return Fold(number, both, people, motions(of["train"]))


def unit_of(clip: ClipRecord) -> str:
    """Return the pair of people of a clip, in either order, or its recording without names."""
    people = sorted({clip.subject_a, clip.subject_b} - {""})
    return "+".join(people) or clip.recording


def trained(models: Path, n_samples: int, fold: Fold, act: str) -> Pairs:
    """Return reactions of the fold's own weights."""
    model = _model_of(models / str(fold.number) / "pacmo/1/weights.safetensors")
    return react_to(model, fold.acts[act], n_samples, finish=True)


def nearest(model: Generator, n_samples: int, fold: Fold, act: str) -> Pairs:
    """Return the reactions of the nearest training partners, finished as those of a model."""
    clips = [clip for of_act in fold.train.values() for clip in of_act]
    copies = TrainingReactions.of(clips, N_POINTS)
    return [
        (clip, finished(model, clip, copies.several_nearest(clip, n_samples)))
        for clip in fold.acts[act]
    ]


def another(model: Generator, n_samples: int, fold: Fold, act: str) -> Pairs:
    """Return training reactions in the same act and the same role, finished as those of a model."""
    random = np.random.default_rng(fold.number)
    found: Pairs = []
    for number, clip in enumerate(fold.acts[act]):
        is_swapped = number >= len(fold.acts[act]) // 2
        here, of_act = to_partner_frame(clip), fold.train[act]
        drawn = random.choice(len(of_act), n_samples, replace=len(of_act) < n_samples)
        others = [of_act[row].swapped() if is_swapped else of_act[row] for row in drawn]
        copies = [replace_reaction(here, to_partner_frame(other)).person_b for other in others]
        found.append((here, finished(model, here, np.stack(copies))))
    return found


def scores(by_act: Sequence[tuple[str, Pairs]], counts: Counts) -> dict[str, float]:
    """Score the reactions of one row, of each fold and act."""
    found = pooled([pair for _, pairs in by_act for pair in pairs], counts)
    shaken = [pair for act, pairs in by_act if act == "shaking hands" for pair in pairs]
    blows = [pair for act, pairs in by_act if act in BLOWS for pair in pairs]
    given_way = [pair for pair in blows if is_given_way(pair[0])]
    real = [(clip, clip.person_b[None]) for clip, _ in given_way]
    found |= {"handshake": right_hands(shaken)} if shaken else {}
    return found | (
        {"gives_way": mean_way(given_way), "gives_way_captured": mean_way(real)} if blows else {}
    )


if __name__ == "__main__":
    main()
