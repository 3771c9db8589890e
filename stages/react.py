"""Let a trained model react to the partner of every test clip, once, at the clip's own frames.

Usage: python -m stages.react MODEL CLIPS REACTIONS
"""

import sys
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


@dataclass(frozen=True)
class Params:
    """The ``react`` section of ``params.yaml``."""

    random_seed: int


def main(model: Path, clips: Path, reactions: Path) -> None:
    params = read_params("react", Params)
    torch.set_num_threads(1)
    config, state = read_weights(model / WEIGHTS)
    reactor = BUILDERS[config["kind"]](config["model"], state)

    def answer(name: str, _facts: ClipFacts, seen: Interaction) -> Motion:
        random = torch.Generator().manual_seed(seed_of(name, params.random_seed))
        times = seen.times
        (motion,) = react(
            reactor, seen.person_a, times, out_times=times, n_samples=1, random=random
        )
        reaction: Motion = motion
        return reaction

    write_reactions(clips, reactions, answer)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
