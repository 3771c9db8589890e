"""The losses of the conditional WGAN: Wasserstein distance, gradient penalty, penalties on bones.

PaCMO, sections 3.2 and 4.2; the gradient penalty is that of Gulrajani et al. (2017).
"""

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.operators.quadrature import trapezoid_weights
from pacmo_core.reaction.critic import Critic, gradient_penalty
from pacmo_core.reaction.data import Condition, MotionPairs
from pacmo_core.reaction.energy_score import ContactScore, EnergyScore
from pacmo_core.reaction.generator import Generator
from pacmo_core.reaction.settings import PacmoSettings


class BoneSymmetryPenalty:
    """Soft constraint that left and right bones have equal lengths (PaCMO, 4.2).

    Parameters
    ----------
    skeleton : Skeleton
    """

    def __init__(self, skeleton: Skeleton) -> None:
        self.bones = torch.from_numpy(skeleton.bones[skeleton.mirrored_bones])  # (S, 2, 2)

    def __call__(self, motion: Tensor, weights: Tensor) -> Tensor:
        """Return the integral of ``sum (left - right)^2`` over time, mean over the batch, m^2.

        Parameters
        ----------
        motion : (B, T, 3 J), metres
        weights : (T,), of the quadrature
        """
        left, right = _bone_lengths(motion, self.bones).unbind(-1)
        integral: Tensor = (left - right).square().sum(dim=-1) @ weights
        return integral.mean()


class BoneLengthPenalty:
    """Soft constraint that bones have constant lengths: joint positions alone do not imply it.

    Parameters
    ----------
    skeleton : Skeleton
    """

    def __init__(self, skeleton: Skeleton) -> None:
        self.bones = torch.from_numpy(skeleton.bones)  # (J - 1, 2)

    def __call__(self, motion: Tensor, weights: Tensor) -> Tensor:
        """Return the sum of the bone lengths' variances over time, mean over the batch, m^2.

        Parameters
        ----------
        motion : (B, T, 3 J), metres
        weights : (T,), of the quadrature on [0, 1]; they sum to 1
        """
        lengths = _bone_lengths(motion, self.bones).transpose(1, 2)  # (B, J - 1, T)
        deviation = lengths - (lengths @ weights)[..., None]
        variance: Tensor = deviation.square() @ weights
        return variance.sum(dim=-1).mean()


def _bone_lengths(motion: Tensor, bones: Tensor) -> Tensor:
    """From ``(B, T, 3 J)`` and ``(..., 2)`` parents and children to ``(B, T, ...)`` metres."""
    joints = motion.view(*motion.shape[:2], -1, 3)
    parents, children = bones.long().unbind(-1)
    bone = joints[:, :, children] - joints[:, :, parents]
    # A nanometre at least: the square root is not differentiable at zero.
    length: Tensor = (bone.square().sum(dim=-1) + 1e-18).sqrt()
    return length


LossAndTerms = tuple[Tensor, dict[str, Tensor]]


@dataclass(frozen=True)
class WganBatch:
    """A batch of real pairs and the random numbers that a step needs.

    Parameters
    ----------
    real : MotionPairs, (B, N, 3 J)
    noise : (S, B, k, 2 K) coefficients of the random field, for S reactions to each partner
    interpolation : (B, 1, 1), uniform on [0, 1]; where between generated and real motion the
        gradient penalty is taken
    """

    real: MotionPairs
    noise: Tensor
    interpolation: Tensor


class WganLosses:
    """The losses of critic and generator, each with its terms by name.

    On a GPU the networks may run in mixed precision, and the generator compiled; losses and the
    gradient penalty stay in single precision.

    Parameters
    ----------
    generator, critic : on one device
    settings : PacmoSettings
    """

    def __init__(self, generator: Generator, critic: Critic, settings: PacmoSettings) -> None:
        self.generator, self.critic, self.settings = generator, critic, settings
        self.bone_symmetry = BoneSymmetryPenalty(generator.skeleton)
        self.energy_score = EnergyScore(generator.skeleton)
        self.contact_score = ContactScore(generator.skeleton, settings.contact_score)
        self.bone_length = BoneLengthPenalty(generator.skeleton)
        self.weights = trapezoid_weights(generator.points)
        self._device = generator.points.device.type
        on_gpu = self._device == "cuda"
        self._mixed_precision = settings.mixed_precision and on_gpu
        # The generator alone: a compiled critic can't be differentiated twice.
        compiled = settings.compile_generator and on_gpu
        self._run_generator = torch.compile(generator) if compiled else generator

    def critic_loss(self, batch: WganBatch) -> LossAndTerms:
        """Gradient penalty minus Wasserstein distance (PaCMO, eqs. 1 and 2)."""
        real, condition = self._normalise(batch.real)
        with torch.no_grad():
            generated = self.generator.normalisation.normalise_reaction(self.generate(batch)[0])
        real_score, generated_score = self._score(torch.stack([real, generated]), batch.real)
        penalty, norm = gradient_penalty(
            lambda reaction, partner: self.critic(reaction, replace(condition, partner=partner)),
            generated.lerp(real, batch.interpolation),
            condition.partner,
            self.weights,
        )
        distance = real_score.mean() - generated_score.mean()  # eq. 1
        loss = self.settings.gradient_penalty_weight * penalty - distance
        terms = {"wasserstein_distance": distance, "gradient_penalty": penalty}
        return loss, {**terms, "gradient_norm": norm}

    def generator_loss(self, batch: WganBatch, *, use_critic: bool) -> LossAndTerms:
        """Penalties on bones and energy score minus the critic's score of the reactions."""
        settings = self.settings
        reactions = self.generate(batch)  # metres
        generated = self.generator.normalisation.normalise_reaction(reactions)
        flat = reactions.flatten(0, 1)
        terms = {"bone_symmetry": self.bone_symmetry(flat, self.weights)}
        loss = settings.bone_symmetry_weight * terms["bone_symmetry"]
        if use_critic:
            terms["critic_score"] = self._score(generated, batch.real).mean()
            loss = loss - terms["critic_score"]
        if settings.energy_score_weight:
            scores = self._energy_scores(reactions, generated, batch.real)
            terms |= scores
            loss = loss + settings.energy_score_weight * torch.stack([*scores.values()]).sum()
        if settings.bone_length_weight:
            terms["bone_length_variance"] = self.bone_length(flat, self.weights)
            loss = loss + settings.bone_length_weight * terms["bone_length_variance"]
        return loss, terms

    def _energy_scores(
        self, reactions: Tensor, generated: Tensor, real: MotionPairs
    ) -> dict[str, Tensor]:
        """Return the mean energy scores of ``(S, B, N, 3 J)`` metres, and the same normalised."""
        ground_truth, _ = self._normalise(real)
        motion = self.energy_score(generated, ground_truth, self.weights)
        scores = {"energy_score": motion.mean()}
        if self.settings.contact_score.is_used:
            spread = self.settings.contact_score.spread
            contact = self.contact_score(reactions, real, self.weights, spread)
            scores["contact_score"] = self.contact_score.total(contact).mean()
        return scores

    def generate(self, batch: WganBatch) -> Tensor:
        """Generate S reactions to each of the batch's partners: ``(S, B, N, 3 J)`` metres."""
        real = batch.real.repeat(len(batch.noise))
        with self._autocast():
            reactions: Tensor = self._run_generator(batch.noise.flatten(0, 1), real.condition)
        return reactions.float().view(len(batch.noise), *batch.real.reaction.shape)

    def _score(self, reactions: Tensor, pairs: MotionPairs) -> Tensor:
        """Apply the critic to S normalised reactions to each partner: ``(S, B)``."""
        _, condition = self._normalise(pairs.repeat(len(reactions)))
        with self._autocast():
            scores: Tensor = self.critic(reactions.flatten(0, 1), condition)
        return scores.float().view(len(reactions), -1)

    def _normalise(self, pairs: MotionPairs) -> tuple[Tensor, Condition]:
        normalisation = self.generator.normalisation
        partner = normalisation.normalise_partner(pairs.partner)
        condition = replace(pairs.condition, partner=partner)
        return normalisation.normalise_reaction(pairs.reaction), condition

    def _autocast(self) -> torch.autocast:
        return torch.autocast(self._device, torch.bfloat16, enabled=self._mixed_precision)
