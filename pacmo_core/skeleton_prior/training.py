"""Training of skeleton priors: every model has the same loss, batches and number of steps.

The loss is an evidence lower bound with smooth L1 terms. The supplement states none: the terms
follow from the metrics that it reports.
"""

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
from pacmo_core.skeleton_prior.settings import (
    LossWeights,
    PriorConfig,
    SkeletonPriorSettings,
    StartSettings,
)
from pacmo_core.skeleton_prior.start import contact_weights, squared_distances
from pacmo_core.skeleton_prior.vae import DiagonalGaussian, SkeletonPrior, fit_skeleton_vae
from pacmo_core.training.loop import TrainingLoop
from pacmo_core.training.supervised import SupervisedTrainer

# Variations per batch of the validation.
VALIDATION_BATCH_SIZE = 16
# Metres: distance at which the weight of a pair of joints has fallen to 1/e.
CONTACT_DISTANCE = 0.15
# Square metres, added before square roots, whose gradient is infinite at zero.
SMALLEST_SQUARE = 1e-8
# Errors below this share of the displacements count quadratically, larger ones linearly, as in E_r.
QUADRATIC_BELOW = 0.1


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
        motions, posteriors = self.model.reconstruct(
            batch.template, batch.scales, batch.variation, as_used, step_random
        )
        weights = replace(
            settings.loss_weights,
            kl_divergence=self.kl_warmup * settings.loss_weights.kl_divergence,
        )
        loss = weighted_loss(self.model, batch, motions, posteriors, weights)
        if weights.energy_score and as_used.any():
            drawn = batch.select(as_used.to(batch.template.device))
            score = sample_energy_score(self.model, drawn, step_random)
            loss = loss + weights.energy_score * score
        return loss

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
        if settings.swap_characters and self.model.first.symmetric:
            batch = batch.swapped(swapped.to(batch.template.device))
        return batch


def weighted_loss(
    model: SkeletonPrior,
    batch: ExampleBatch,
    motions: Tensor,
    posteriors: tuple[DiagonalGaussian, DiagonalGaussian],
    weights: LossWeights,
) -> Tensor:
    """Sum the terms of the loss of reconstructed motions (B, T, 2, J, 3), metres.

    Positions, bone lengths and distances are in units of the data's displacements.
    """
    scale, (first, second) = model.displacement_scale, posteriors
    error = (motions - batch.variation) / scale
    bones = _bone_lengths(motions, model) - _bone_lengths(batch.variation, model)
    position = _smooth_l1(error).mean()
    kl_divergence = (first.kl_divergence() + second.kl_divergence()) / 2
    bone_length = _smooth_l1(bones / scale).mean()
    near = contact_weights(squared_distances(*batch.template.unbind(dim=2)), CONTACT_DISTANCE)
    distances = _smooth_l1((_pair_distances(motions) - _pair_distances(batch.variation)) / scale)
    contact_distance = (near * distances).sum() / near.sum().clamp_min(1)
    joint_distance = distances.mean()
    acceleration = _smooth_l1(error[:, 2:] - 2 * error[:, 1:-1] + error[:, :-2]).mean()
    return (
        position
        + weights.bone_length * bone_length
        + weights.contact_distance * contact_distance
        + weights.joint_distance * joint_distance
        + weights.acceleration * acceleration
        + weights.kl_divergence * kl_divergence
    )


def sample_energy_score(
    model: SkeletonPrior, batch: ExampleBatch, random: torch.Generator
) -> Tensor:
    """Return the energy score of two samples of each body, from the latents' prior.

    The distance from the solver's motion less half of that between the samples (Gneiting and
    Raftery 2007, section 4.3), which is least where samples vary as the solver's solutions do. The
    posteriors alone do not see to that: what they encode need not be what the prior draws.
    Distances are of windows as a whole: root mean squares of joint positions, and of distances
    between the characters, in units of the data's displacements.
    """
    first, second = (
        model.joint_positions(
            model.decode(batch.template, batch.scales, random), batch.template, batch.scales
        )
        for _ in range(2)
    )

    def distance(one: Tensor, other: Tensor) -> Tensor:
        pairs = _pair_distances(one) - _pair_distances(other)
        squares = ((one - other).square().sum(dim=-1), pairs.square())
        parts = (square.flatten(1).mean(dim=1) + SMALLEST_SQUARE for square in squares)
        return torch.stack([part.sqrt() for part in parts]).sum(dim=0).mean()

    errors = (distance(first, batch.variation) + distance(second, batch.variation)) / 2
    score: Tensor = (errors - distance(first, second) / 2) / model.displacement_scale
    return score


def _bone_lengths(motions: Tensor, model: SkeletonPrior) -> Tensor:
    parent, child = model.config.skeleton.bones.T
    lengths: Tensor = (motions[..., child, :] - motions[..., parent, :]).norm(dim=-1)
    return lengths


def _smooth_l1(error: Tensor) -> Tensor:
    zero = torch.zeros_like(error)
    return torch.nn.functional.smooth_l1_loss(error, zero, reduction="none", beta=QUADRATIC_BELOW)


def _pair_distances(motions: Tensor) -> Tensor:
    """Compute distances between the characters' joints, (B, T, J, J), metres."""
    return squared_distances(*motions.unbind(dim=2)).clamp_min(1e-6).sqrt()


def mean_position_error(model: SkeletonPrior, examples: ExampleDataset) -> Tensor:
    """Compute the mean position error of retargeting, metres, with latents at the prior's mean."""
    errors = []
    for batch in examples.full_length_batches(model.config.frame_stride, VALIDATION_BATCH_SIZE):
        outputs = model.decode(batch.template, batch.scales, None)
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
        given = model.first_condition(batch.template, batch.scales)
        after = model.second_condition(batch.template, batch.scales, first)
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
