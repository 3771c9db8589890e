"""Fit a trained model's contacts to what it generates for partners that it was not trained on."""

from collections.abc import Iterator, Sequence

import numpy as np
import torch

from pacmo_core.data.interaction import Interaction
from pacmo_core.reaction.baselines import Gru
from pacmo_core.reaction.contacts import Pairs, find_pairs, learn_contacts
from pacmo_core.reaction.data import expand_directions
from pacmo_core.reaction.inference import react_all
from pacmo_core.reaction.windows import PartnerMotion, ReactionModel, is_deterministic
from pacmo_core.training.loop import TrainingData

MAX_CLIPS = 200  # evenly among those there are
N_SAMPLES = 2  # reactions to each partner, of a generative model
RANDOM_SEED = 1


def fit_contacts(model: ReactionModel, data: TrainingData[Interaction]) -> None:
    """Learn ``model.contact_model`` in place, on validation clips; without any, on training clips.

    Reactions to training partners are nearer to the captured ones than those to others, and would
    teach that a hand that stops short has not arrived.

    Parameters
    ----------
    model : trained
    data : clips, with labels if the model is conditioned on them
    """
    clips, labels = (
        (data.validation, data.validation_actions)
        if data.validation
        else (data.train, data.train_actions)
    )
    labelled = list(zip(clips, labels or [""] * len(clips), strict=True))
    known = () if isinstance(model, Gru) else model.config.actions
    usable = [(clip, label if known else "") for clip, label in labelled]
    usable = [pair for pair in usable if not known or pair[1] in known]
    chosen = np.unique(np.linspace(0, len(usable) - 1, MAX_CLIPS).round().astype(int))
    learnt = learn_contacts(_pairs(model, [usable[i] for i in chosen if usable]), model.skeleton)
    model.contact_model.copy_(torch.from_numpy(learnt))


def _pairs(
    model: ReactionModel, labelled: Sequence[tuple[Interaction, str]]
) -> Iterator[tuple[Pairs, Pairs]]:
    """Yield the pairs of joints of generated and of captured reactions."""
    random = torch.Generator().manual_seed(RANDOM_SEED)
    n_samples = 1 if is_deterministic(model) else N_SAMPLES
    for clip, label in labelled:
        for directed in expand_directions([clip], both=True):
            times = directed.times
            partner = PartnerMotion(directed.person_a, times, times, label)
            (reactions,) = react_all(model, [partner], n_samples=n_samples, random=random)
            fps = float(1 / np.median(np.diff(times)))
            captured = find_pairs(directed.person_b, directed.person_a, fps, model.skeleton)
            for reaction in reactions:
                yield find_pairs(reaction, directed.person_a, fps, model.skeleton), captured
