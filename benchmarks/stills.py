"""Stills of motions in random order and without names, for eyes that have not seen them made.

Usage: python -m benchmarks.stills OUT [ROW=MOTIONS ...] [--each N] [--seed N] [--weights W]

MOTIONS is a Parquet file, or a folder of them, of clips or reactions, such as
``data/reactions/1/oracle/1`` after a run. With ``PACMO_REAL_DATA`` three rows are of SBU, either
person as the partner: ``sbu_captured``, ``sbu_package`` (reactions of W, by default the weights in
the package, one sample each) and ``sbu_another`` (another's captured reaction in the same act,
finished as these). N clips of each row at random, other partners in each as far as there are.

Writes ``OUT/001.png`` and on, sixteen instants each, and ``OUT/key.json``: the row and the clip of
each, for whoever counts afterwards and not for whoever looks. Prints how many pictures are of each
row.
"""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from benchmarks._figures import arguments, show
from benchmarks._recorded import finished, model_at, permuted, react_to, recorded
from pacmo_core.data.interaction import Interaction
from pacmo_core.figures.stills import write_strip
from pacmo_core.figures.viewer import Scene
from pacmo_core.formats.sbu import Sbu
from pacmo_core.reaction.generator import Generator
from pacmo_core.reaction.inference import PACKAGED
from pacmo_core.store.motions import stream_folder, stream_motions

Picture = tuple[str, str, Interaction]  # row, clip, motion


def main() -> None:
    """Draw and count."""
    parser = arguments(__doc__ or "")
    parser.add_argument("out", type=Path)
    parser.add_argument("rows", nargs="*", metavar="ROW=MOTIONS")
    parser.add_argument("--each", type=int, default=12, help="pictures of each row")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--weights", type=Path, default=PACKAGED)
    options = parser.parse_args()
    torch.set_num_threads(1)
    random = np.random.default_rng(options.seed)
    pictures = [
        (name, clip, motion)
        for name, _, path in (row.partition("=") for row in options.rows)
        for clip, motion in drawn(list(motions_of(Path(path))), options.each, random)
    ]
    pictures += of_sbu(model_at(options.weights, None), options.each, random)
    options.out.mkdir(parents=True, exist_ok=True)
    key = {}
    for number, picture in enumerate(random.permutation(len(pictures)).tolist(), start=1):
        row, clip, motion = pictures[picture]
        key[f"{number:03}"] = {"row": row, "clip": clip}
        people = (motion.person_a, motion.person_b)
        scene = Scene("", motion.skeleton, motion.times - motion.times[0], people)
        write_strip(options.out / f"{number:03}.png", scene)
    (options.out / "key.json").write_text(json.dumps(key, indent=1) + "\n")
    rows = [row for row, _, _ in pictures]
    show({row: rows.count(row) for row in dict.fromkeys(rows)}, as_json=options.json)


def motions_of(path: Path) -> Iterator[tuple[str, Interaction]]:
    """Yield the motions of a file or a folder with their names."""
    return stream_folder(path) if path.is_dir() else stream_motions(path)


def drawn(
    named: list[tuple[str, Interaction]], count: int, random: np.random.Generator
) -> list[tuple[str, Interaction]]:
    """Return some of them at random, all different."""
    chosen = random.permutation(len(named))[:count].tolist()
    return [named[number] for number in chosen]


def of_sbu(model: Generator, count: int, random: np.random.Generator) -> list[Picture]:
    """Return captured, generated and others' reactions, to different partners."""
    sets = recorded(model.skeleton, Sbu(fps=15))
    if "sbu" not in sets:
        return []
    clips, pictures = sets["sbu"], list[Picture]()
    others = {act: list(permuted(of_act, clips.people[act])) for act, of_act in clips.acts.items()}
    numbered = [
        (act, number) for act, of_act in clips.acts.items() for number in range(len(of_act))
    ]
    chosen = [numbered[one] for one in random.permutation(len(numbered))[: 3 * count].tolist()]
    for place, (act, number) in enumerate(chosen):
        clip, (here, other) = clips.acts[act][number], others[act][number]
        row = ("sbu_captured", "sbu_package", "sbu_another")[place % 3]
        if row == "sbu_package":
            ((_, reactions),) = react_to(model, [clip], 1, finish=True)
        elif row == "sbu_another":
            clip, reactions = here, finished(model, here, other)
        else:
            reactions = clip.person_b[None]
        pictures.append((row, f"{act} {number}", replace(clip, person_b=reactions[0])))
    return pictures


if __name__ == "__main__":
    main()
