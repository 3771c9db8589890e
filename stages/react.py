"""Generate a reaction to the partner of every test clip, at the frames of the clip.

Usage: python -m stages.react --seed=S [--without-finish] MODEL CLIPS SPLITS.parquet REACTIONS

A generative model gives several samples, a deterministic one gives one. The reactions of the models
that ``finish`` lists are finished, unless ``--without-finish`` is given.
"""

import argparse
from dataclasses import dataclass
from pathlib import Path

import torch

from pacmo_core.data.interaction import Interaction, Motion
from pacmo_core.models import load_reaction_model, model_names
from pacmo_core.reaction.inference import finish_reactions, react_all
from pacmo_core.reaction.inputs import UNLABELLED
from pacmo_core.reaction.windows import PartnerMotion, is_deterministic, needs_label
from pacmo_core.store.tables import ClipRecord
from pacmo_core.store.weights import read_weights
from stages.common.clips import clip_seed, write_reactions
from stages.common.files import WEIGHTS
from stages.common.params import read_params, run_stage


@dataclass(frozen=True)
class Params:
    """The ``react`` section of ``params.yaml``."""

    random_seed: int
    n_samples: int  # reactions to each partner, of a generative model
    finish: list[str]  # models whose reactions are finished

    def __post_init__(self) -> None:
        unknown = sorted(set(self.finish) - set(model_names("reaction")))
        if unknown:
            known = ", ".join(model_names("reaction"))
            raise ValueError(f"finish must be some of {known}; got {', '.join(unknown)}")


def main(paths: argparse.Namespace) -> None:
    params = read_params("react", Params)
    torch.set_num_threads(1)
    reactor = load_reaction_model(paths.model / WEIGHTS)
    facts, _ = read_weights(paths.model / WEIGHTS)
    finished = facts["model"] in params.finish and not paths.without_finish
    n_samples = 1 if is_deterministic(reactor) else params.n_samples

    def sample_reactions(name: str, facts: ClipRecord, directed: Interaction) -> Motion:
        clip_random_seed = clip_seed(f"{paths.seed}\0{name}", params.random_seed)
        random = torch.Generator().manual_seed(clip_random_seed)
        action = facts.action if needs_label(reactor) else UNLABELLED
        partner = PartnerMotion(directed.person_a, directed.times, directed.times, action)
        (motion,) = react_all(reactor, [partner], n_samples=n_samples, random=random)
        return finish_reactions(reactor, partner, motion) if finished else motion

    write_reactions(paths.clips, paths.splits, paths.reactions, sample_reactions)


def arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser()
    for name in ("model", "clips", "splits", "reactions"):
        parser.add_argument(name, type=Path)
    parser.add_argument("--seed", type=int, required=True, help="of the training run")
    parser.add_argument("--without-finish", action="store_true", help="as the model generates them")
    return parser.parse_args()


if __name__ == "__main__":
    run_stage(main, arguments())
