"""Training of skeleton priors: every model has the same losses, batches and number of steps."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.models import build_skeleton_prior
from pacmo_core.skeleton_prior.data import Example, ExampleBatch, ExampleDataset, encode_examples
from pacmo_core.skeleton_prior.kinematics import find_limbs
from pacmo_core.skeleton_prior.layers import initialise_weights
from pacmo_core.skeleton_prior.losses import loss_terms, total_loss
from pacmo_core.skeleton_prior.settings import PriorConfig, SkeletonPriorSettings, StartSettings
from pacmo_core.skeleton_prior.skeleton_vae import fit_skeleton_vae
from pacmo_core.skeleton_prior.vae import SkeletonPrior
from pacmo_core.training.loop import TrainingLoop
from pacmo_core.training.supervised import SupervisedTrainer

# Variations per batch of the validation.
VALIDATION_BATCH_SIZE = 16


class SkeletonPriorTrainer(SupervisedTrainer[SkeletonPrior]):
    """Trains both motion VAEs; the weight of the KL divergence rises over the first epochs.

    A step draws one number from the generator of the batch order, which seeds everything else: so
    batches, windows and rotations are the same for every model.
    """

    def __init__(
        self,
        model: SkeletonPrior,
        examples: ExampleDataset,
        validation: ExampleDataset | None,
        settings: SkeletonPriorSettings,
        random: torch.Generator,
    ) -> None:
        self.examples, self.validation = examples, validation
        self.prior_settings, self.kl_warmup = settings, 0.0
        held_out = None if validation is None else lambda: mean_position_error(model, validation)
        super().__init__(model, len(examples), self._loss, held_out, settings, random)

    def train_epoch(self, number: int) -> dict[str, float]:
        """Train on every example once."""
        self.model.train()
        self.kl_warmup = min(1.0, (number + 1) / self.prior_settings.kl_warmup_epochs)
        terms = super().train_epoch(number)
        self.model.eval()
        return terms

    def validate(self) -> dict[str, Tensor]:
        """Return the error on validation data, and the KL divergence of an element of a latent."""
        terms = super().validate()
        if terms and self.validation is not None:
            with torch.no_grad():
                terms["kl_first"], terms["kl_second"] = mean_kl(self.model, self.validation)
        return terms

    def _loss(self, rows: Tensor) -> Tensor:
        settings = self.prior_settings
        seed = int(torch.randint(2**62, (), generator=self.random))
        step_random = torch.Generator().manual_seed(seed)
        batch = self._batch(rows, step_random)
        as_used = torch.rand(len(rows), generator=step_random) < settings.used_share
        result = self.model.reconstruct(
            batch.template, batch.scales, batch.variation, as_used, step_random
        )
        config, scale = self.model.config, self.model.displacement_scale
        terms = loss_terms(result, batch.variation, batch.template, config.skeleton, scale)
        return total_loss(terms, settings.loss_weights, self.kl_warmup)

    def _batch(self, rows: Tensor, random: torch.Generator) -> ExampleBatch:
        settings = self.prior_settings
        batch = self.examples.random_windows(
            rows, settings.frame_stride, settings.window_frames, random
        )
        # Sampled whether or not they are used, so that every model has the same sequence.
        angles = torch.rand(len(rows), generator=random) * 2 * math.pi
        swapped = torch.rand(len(rows), generator=random) < 0.5
        mirrored = torch.rand(len(rows), generator=random) < settings.mirror_probability
        batch = batch.mirrored(mirrored.to(batch.template.device), self.model.config.skeleton)
        if settings.random_rotation:
            batch = batch.rotated(angles.to(batch.template.device))
        if settings.swap_characters and self.model.symmetric:
            batch = batch.swapped(swapped.to(batch.template.device))
        return batch


def mean_position_error(model: SkeletonPrior, examples: ExampleDataset) -> Tensor:
    """Compute the mean position error of retargeting, metres, with latents at the prior's mean."""
    errors = []
    for batch in examples.full_length_batches(model.config.frame_stride, VALIDATION_BATCH_SIZE):
        latents = model.sample_latents(batch.template, batch.scales, None)
        outputs = model.decode(batch.template, batch.scales, latents)
        positions = model.joint_positions(outputs, batch.template, batch.scales)
        errors.append((positions - batch.variation).norm(dim=-1).mean(dim=(1, 2, 3)))
    return torch.cat(errors).mean()


def mean_kl(model: SkeletonPrior, examples: ExampleDataset) -> Tensor:
    """Compute both posteriors' KL divergence (2,) from the prior, nats an element of the latent.

    Zero where the latents hold nothing: the posterior has collapsed.
    """
    rows = []
    for batch in examples.full_length_batches(model.config.frame_stride, VALIDATION_BATCH_SIZE):
        first, second = batch.variation.unbind(dim=2)
        given = model.first_inputs(batch.template, batch.scales)
        after = model.second_inputs(batch.template, batch.scales, first)
        posteriors = model.first.encode(first, given), model.second.encode(second, after)
        rows.append(torch.stack([posterior.kl_divergence() for posterior in posteriors]))
    return torch.stack(rows).mean(dim=0)


def build_training(
    examples: Sequence[Example],
    settings: SkeletonPriorSettings,
    *,
    validation: Sequence[Example] = (),
    device: str = "cpu",
) -> TrainingLoop[SkeletonPrior]:
    """Train the skeleton VAE, and build the loop that trains the motion VAEs.

    An epoch yields ``loss``.
    """
    random = torch.Generator().manual_seed(settings.random_seed)
    training_data = encode_examples(examples).to(device)
    validation_data = encode_examples(validation).to(device) if validation else None
    template = examples[0].template
    model = build_skeleton_prior(
        PriorConfig(
            skeleton=template.skeleton,
            limbs=find_limbs(template.skeleton, template.person_a),
            model=settings.model,
            hidden=settings.hidden,
            frame_stride=settings.frame_stride,
            fps=float(np.median([example.template.fps for example in examples])),
            start=settings.start,
        )
    )
    initialise_weights(model.skeleton_vae, random)
    fit_skeleton_vae(
        model.skeleton_vae,
        training_data.scales[:, 0].cpu(),  # only the first character's scales differ from 1
        n_steps=settings.skeleton_vae_steps,
        random=random,
    )
    initialise_weights(model.first, random)
    initialise_weights(model.second, random)
    model.fit_displacement_scale(training_data)
    trainer = SkeletonPriorTrainer(
        model.to(device).eval(),
        training_data,
        validation_data,
        settings,
        torch.Generator().manual_seed(settings.random_seed + 1),
    )
    return TrainingLoop(
        trainer,
        n_epochs=settings.n_epochs,
        validate_every=settings.validate_every,
        validate_untrained=True,  # the start of the kinematic model
    )


def build_start(config: PriorConfig) -> SkeletonPrior:
    """Build the kinematic model before training, in evaluation mode: the start alone."""
    model = build_skeleton_prior(replace(config, model="kinematic"))
    initialise_weights(model, torch.Generator().manual_seed(0))
    return model.eval().requires_grad_(False)


def prior_from_state(config: Mapping[str, Any], state: Mapping[str, Tensor]) -> SkeletonPrior:
    """Rebuild a trained model from its configuration and weights, frozen, in evaluation mode."""
    parsed = {
        "skeleton": Skeleton.from_dict(config["skeleton"]),
        "limbs": tuple((start, middle, end) for start, middle, end in config["limbs"]),
        "start": StartSettings(**config["start"]),
    }
    model = build_skeleton_prior(PriorConfig(**{**config, **parsed}))
    model.load_state_dict(dict(state))
    return model.eval().requires_grad_(False)
