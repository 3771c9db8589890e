"""The losses of the conditional WGAN: Wasserstein distance, gradient penalty, penalties on bones.

PaCMO, sections 3.2 and 4.2; the gradient penalty is that of Gulrajani et al. (2017).
"""

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.operators.quadrature import trapezoid_weights
from pacmo_core.reaction.critic import Critic, gradient_norm
from pacmo_core.reaction.data import Condition, MotionPairs
from pacmo_core.reaction.energy_score import EnergyScore
from pacmo_core.reaction.generator import Generator
from pacmo_core.reaction.settings import PacmoSettings


class BoneSymmetryPenalty:
    """The soft constraint that mirror bones be of one length (PaCMO, 4.2).

    Parameters
    ----------
    skeleton : Skeleton
    """

    def __init__(self, skeleton: Skeleton) -> None:
        self.bones = torch.from_numpy(skeleton.bones[skeleton.mirrored_bones])  # (S, 2, 2)

    def __call__(self, motion: Tensor, weights: Tensor) -> Tensor:
        """Integrate ``sum (left - right)^2`` over time, mean over the batch, metres squared.

        Parameters
        ----------
        motion : (B, T, 3 J), metres
        weights : (T,), of the quadrature
        """
        left, right = _bone_lengths(motion, self.bones).unbind(-1)
        integral: Tensor = (left - right).square().sum(dim=-1) @ weights
        return integral.mean()


class BoneLengthPenalty:
    """The soft constraint that bones keep their lengths: joints' positions alone can stretch.

    Parameters
    ----------
    skeleton : Skeleton
    """

    def __init__(self, skeleton: Skeleton) -> None:
        self.bones = torch.from_numpy(skeleton.bones)  # (J - 1, 2)

    def __call__(self, motion: Tensor, weights: Tensor) -> Tensor:
        """Sum the bones' variances over time, mean over the batch, metres squared.

        Parameters
        ----------
        motion : (B, T, 3 J), metres
        weights : (T,), of the quadrature on [0, 1]; they sum to 1
        """
        lengths = _bone_lengths(motion, self.bones).transpose(1, 2)  # (B, J - 1, T)
        departure = lengths - (lengths @ weights)[..., None]
        variance: Tensor = departure.square() @ weights
        return variance.sum(dim=-1).mean()


def _bone_lengths(motion: Tensor, bones: Tensor) -> Tensor:
    """``(B, T, 3 J)`` and ``(..., 2)`` parents and children to ``(B, T, ...)`` metres."""
    joints = motion.view(*motion.shape[:2], -1, 3)
    parents, children = bones.long().unbind(-1)
    bone = joints[:, :, children] - joints[:, :, parents]
    # The root of zero has no slope; a bone of no length is a nanometre long here.
    length: Tensor = (bone.square().sum(dim=-1) + 1e-18).sqrt()
    return length


LossAndTerms = tuple[Tensor, dict[str, Tensor]]


@dataclass(frozen=True)
class WganBatch:
    """Some rows of a batch.

    Parameters
    ----------
    real : MotionPairs, (B, N, 3 J)
    noise : (S, B, k, 2 K), a generator's ``draw`` for S reactions to each partner
    mixing : (B, 1, 1), uniform on [0, 1]
    """

    real: MotionPairs
    noise: Tensor
    mixing: Tensor


class WganLosses:
    """What either network descends: a loss, and its terms by name.

    On a GPU the networks may run in reduced precision, and the generator compiled; losses and the
    gradient penalty stay in single precision.

    Parameters
    ----------
    generator, critic : on one device
    settings : PacmoSettings
    """

    def __init__(self, generator: Generator, critic: Critic, settings: PacmoSettings) -> None:
        self.generator, self.critic, self.settings = generator, critic, settings
        self.symmetry = BoneSymmetryPenalty(generator.skeleton)
        self.energy_score = EnergyScore(generator.skeleton)
        self.constant_bones = BoneLengthPenalty(generator.skeleton)
        self.weights = trapezoid_weights(generator.points)
        self._device = generator.points.device.type
        on_gpu = self._device == "cuda"
        self._reduced = settings.mixed_precision and on_gpu
        # The generator alone: a compiled critic can't be differentiated twice.
        compiled = settings.compile_generator and on_gpu
        self._react = torch.compile(generator) if compiled else generator

    def of_critic(self, batch: WganBatch) -> LossAndTerms:
        """Weigh the gradient penalty against the distance of real from made."""
        u, condition = self._normalised(batch.real)
        with torch.no_grad():
            fake = self.generator.normalisation.reaction(self.reactions(batch)[0])
        real, made = self._judge(torch.stack([u, fake]), batch.real)
        norms = gradient_norm(
            lambda a, b: self.critic(a, replace(condition, partner=b)),
            fake.lerp(u, batch.mixing),
            condition.partner,
            self.weights,
        )
        distance = real.mean() - made.mean()  # eq. 1
        penalty = (norms - 1).square().mean()  # eq. 2
        loss = self.settings.gradient_penalty_weight * penalty - distance
        return loss, {
            "wasserstein_distance": distance,
            "gradient_penalty": penalty,
            "gradient_norm": norms.mean(),
        }

    def of_generator(self, batch: WganBatch, *, judged: bool) -> LossAndTerms:
        """Weigh the energy score and the penalties on bones against the critic's judgement."""
        settings = self.settings
        reactions = self.reactions(batch)
        made, every = self.generator.normalisation.reaction(reactions), reactions.flatten(0, 1)
        terms = {"bone_symmetry": self.symmetry(every, self.weights)}
        loss = settings.bone_symmetry_weight * terms["bone_symmetry"]
        if judged:
            terms["critic_score"] = self._judge(made, batch.real).mean()
            loss = loss - terms["critic_score"]
        if settings.energy_score_weight:
            u, _ = self._normalised(batch.real)
            terms["energy_score"] = self.energy_score(
                made, u, self.weights, settings.energy_score_spread
            ).mean()
            loss = loss + settings.energy_score_weight * terms["energy_score"]
        if settings.bone_length_weight:
            terms["bone_length_variance"] = self.constant_bones(every, self.weights)
            loss = loss + settings.bone_length_weight * terms["bone_length_variance"]
        return loss, terms

    def reactions(self, batch: WganBatch) -> Tensor:
        """React to the batch's partners: ``(S, B, N, 3 J)`` metres."""
        real = batch.real.repeat(len(batch.noise))
        with self._precision():
            out: Tensor = self._react(batch.noise.flatten(0, 1), real.condition)
        return out.float().view(len(batch.noise), *batch.real.reaction.shape)

    def _judge(self, made: Tensor, real: MotionPairs) -> Tensor:
        """Judge S normalised motions for each partner: ``(S, B)``."""
        _, condition = self._normalised(real.repeat(len(made)))
        with self._precision():
            judged: Tensor = self.critic(made.flatten(0, 1), condition)
        return judged.float().view(len(made), -1)

    def _normalised(self, pairs: MotionPairs) -> tuple[Tensor, Condition]:
        norm = self.generator.normalisation
        seen = replace(pairs.condition, partner=norm.partner(pairs.partner))
        return norm.reaction(pairs.reaction), seen

    def _precision(self) -> torch.autocast:
        return torch.autocast(self._device, torch.bfloat16, enabled=self._reduced)
