"""Training of a skeleton prior, ours or a baseline: same losses, same batches, same budget."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
import torch
from torch import Tensor

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.models import build_skeleton_prior
from pacmo_core.skeleton_prior.autograd_functions import bfloat16_products
from pacmo_core.skeleton_prior.data import Example, ExampleBatch, ExampleDataset, encode_examples
from pacmo_core.skeleton_prior.kinematics import find_limbs
from pacmo_core.skeleton_prior.layers import initialise_weights
from pacmo_core.skeleton_prior.losses import loss_terms, total_loss
from pacmo_core.skeleton_prior.settings import PriorConfig, SkeletonPriorSettings
from pacmo_core.skeleton_prior.vae import SkeletonPrior, fit_skeleton_vae
from pacmo_core.training.loop import TrainingLoop
from pacmo_core.training.supervised import SupervisedTrainer

# Variations that are scored at once.
SCORE_BATCH_SIZE = 16


class SkeletonPriorTrainer(SupervisedTrainer[SkeletonPrior]):
    """A descent that raises the weight of the divergence over its first epochs.

    Every step draws one number from the order's generator and all else from that: batches, windows
    and turns are the same for every model.

    Parameters
    ----------
    model : trained in place
    examples : to learn from
    validation : to choose weights on; may be empty
    settings : PriorSettings
    random : CPU generator
    """

    def __init__(
        self,
        model: SkeletonPrior,
        examples: ExampleDataset,
        validation: ExampleDataset | None,
        settings: SkeletonPriorSettings,
        random: torch.Generator,
    ) -> None:
        self.examples, self.prior_settings, self.warm = examples, settings, 0.0
        held_out = None if validation is None else lambda: mean_position_error(model, validation)
        super().__init__(model, len(examples), self._loss, held_out, settings, random)

    def train_epoch(self, number: int) -> dict[str, float]:
        """See every row once."""
        self.model.train()
        self.warm = min(1.0, (number + 1) / self.prior_settings.warmup_epochs)
        found = super().train_epoch(number)
        self.model.eval()
        return found

    def _loss(self, rows: Tensor) -> Tensor:
        settings = self.prior_settings
        own = torch.Generator().manual_seed(int(torch.randint(2**62, (), generator=self.random)))
        pairs = self._batch(rows, own)
        with bfloat16_products(settings.mixed_precision):
            return reconstruction_loss(self.model, pairs, settings, self.warm, own)

    def _batch(self, rows: Tensor, own: torch.Generator) -> ExampleBatch:
        settings = self.prior_settings
        pairs = self.examples.windows(rows, settings.stride, settings.window, own)
        turns = torch.rand(len(rows), generator=own) * 2 * math.pi
        swaps = torch.rand(len(rows), generator=own) < 0.5
        if settings.turn:
            pairs = pairs.turned(turns.to(pairs.template.device))
        if settings.swap and self.model.both_roles:
            pairs = pairs.swapped(swaps.to(pairs.template.device))
        return pairs


def reconstruction_loss(
    model: SkeletonPrior,
    pairs: ExampleBatch,
    settings: SkeletonPriorSettings,
    warm: float,
    random: torch.Generator,
) -> Tensor:
    """Take the loss of both characters' VAEs."""
    answer = model.reconstruct(pairs.template, pairs.scales, pairs.varied, random)
    found = loss_terms(answer, pairs.varied, pairs.template, model.tree.parents, model.unit)
    return total_loss(found, settings.weights, warm)


def mean_position_error(model: SkeletonPrior, examples: ExampleDataset) -> Tensor:
    """Take the mean error of joints' places, metres, bodies given and latents at their mean."""
    errors = []
    for pairs in examples.wholes(model.config.stride, SCORE_BATCH_SIZE):
        latents = model.latents(pairs.template, pairs.scales, None)
        fields = model.fields(pairs.template, pairs.scales, latents)
        placed = model.place(fields, pairs.template, pairs.scales)
        errors.append((placed - pairs.varied).norm(dim=-1).mean(dim=(1, 2, 3)))
    return torch.cat(errors).mean()


def build_training(
    examples: Sequence[Example],
    settings: SkeletonPriorSettings,
    *,
    validation: Sequence[Example] = (),
    device: str = "cpu",
) -> TrainingLoop[SkeletonPrior]:
    """Train a model; an epoch yields ``loss``."""
    random = torch.Generator().manual_seed(settings.random_seed)
    learnt = encode_examples(examples).to(device)
    held_out = encode_examples(validation).to(device) if validation else None
    template = examples[0].template
    model = build_skeleton_prior(
        PriorConfig(
            skeleton=template.skeleton,
            limbs=find_limbs(template.skeleton, template.person_a),
            model=settings.model,
            hidden=settings.hidden,
            stride=settings.stride,
            fps=float(np.median([example.template.fps for example in examples])),
            dropout=settings.dropout,
        )
    )
    initialise_weights(model.bodies, random)
    fit_skeleton_vae(
        model.bodies,
        learnt.scales[:, 0].cpu(),  # the first body is the one that changes
        n_steps=settings.body_steps,
        random=random,
    )
    initialise_weights(model.first, random)
    initialise_weights(model.second, random)
    model.measure(learnt)
    training = SkeletonPriorTrainer(
        model.to(device),
        learnt,
        held_out,
        settings,
        torch.Generator().manual_seed(settings.random_seed + 1),
    )
    return TrainingLoop(
        training, n_epochs=settings.n_epochs, validate_every=settings.validate_every
    )


def model_config(model: SkeletonPrior) -> dict[str, Any]:
    """Describe a model in JSON's terms."""
    return asdict(model.config)


def prior_from_state(config: Mapping[str, Any], state: Mapping[str, Tensor]) -> SkeletonPrior:
    """Rebuild a model from what ``config`` and ``fit.state`` gave."""
    own = {
        "skeleton": Skeleton.from_dict(config["skeleton"]),
        "limbs": tuple((start, middle, end) for start, middle, end in config["limbs"]),
    }
    model = build_skeleton_prior(PriorConfig(**{**config, **own}))
    model.load_state_dict(dict(state))
    return model.eval().requires_grad_(False)
