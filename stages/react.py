"""Let a trained model react to the partner of every test clip at the clip's own frames.

Usage: python -m stages.react --seed=S MODEL CLIPS SIDES.parquet REACTIONS

A model that draws its reactions gives several, one that computes them gives one.
"""

import argparse
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from pacmo_core.interaction import Interaction, Motion
from pacmo_core.pacmo import adversarial, gru
from pacmo_core.pacmo.react import Reactor, react
from pacmo_core.store.clips import ClipFacts
from pacmo_core.store.weights import read_weights
from stages._files import WEIGHTS
from stages._params import read_params
from stages._reactions import seed_of, write_reactions

BUILDERS: dict[str, Callable[[Mapping[str, Any], Mapping[str, Tensor]], Reactor]] = {
    "pacmo": adversarial.from_state,
    "gru": gru.from_state,
}
DETERMINISTIC = ("gru",)


@dataclass(frozen=True)
class Params:
    """The ``react`` section of ``params.yaml``."""

    random_seed: int
    n_samples: int  # reactions to each partner, of a model that draws them


def main(model: Path, clips: Path, sides: Path, reactions: Path, *, seed: int) -> None:
    params = read_params("react", Params)
    torch.set_num_threads(1)
    config, state = read_weights(model / WEIGHTS)
    reactor = BUILDERS[config["kind"]](config["model"], state)
    n_samples = 1 if config["kind"] in DETERMINISTIC else params.n_samples

    def answer(name: str, _facts: ClipFacts, seen: Interaction) -> Motion:
        own = seed_of(f"{seed}\0{name}", params.random_seed)
        random = torch.Generator().manual_seed(own)
        times = seen.times
        return react(
            reactor, seen.person_a, times, out_times=times, n_samples=n_samples, random=random
        )

    write_reactions(clips, sides, reactions, answer)


def arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser()
    for name in ("model", "clips", "sides", "reactions"):
        parser.add_argument(name, type=Path)
    parser.add_argument("--seed", type=int, required=True, help="of the training run")
    return parser.parse_args()


if __name__ == "__main__":
    main(**vars(arguments()))
