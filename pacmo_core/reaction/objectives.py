"""The losses of generator and critic, all their terms in one place (PaCMO, 3.2 and 4.2)."""

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from pacmo_core.operators.quadrature import trapezoid_weights
from pacmo_core.reaction.critic import Critic, gradient_norm
from pacmo_core.reaction.energy import EnergyScore
from pacmo_core.reaction.functions import Condition, MotionPairs
from pacmo_core.reaction.generator import Generator
from pacmo_core.reaction.losses import ConstantBones, Symmetry
from pacmo_core.reaction.settings import PacmoSettings

Loss = tuple[Tensor, dict[str, Tensor]]


@dataclass(frozen=True)
class Batch:
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


class Objectives:
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
        self.symmetry = Symmetry(generator.skeleton)
        self.energy_score = EnergyScore(generator.skeleton)
        self.constant_bones = ConstantBones(generator.skeleton)
        self.weights = trapezoid_weights(generator.points)
        self._device = generator.points.device.type
        on_gpu = self._device == "cuda"
        self._reduced = settings.mixed_precision and on_gpu
        # The generator alone: a compiled critic can't be differentiated twice.
        compiled = settings.compile_generator and on_gpu
        self._react = torch.compile(generator) if compiled else generator

    def of_critic(self, batch: Batch) -> Loss:
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
        loss = self.settings.penalty_weight * penalty - distance
        return loss, {"distance": distance, "penalty": penalty, "gradient_norm": norms.mean()}

    def of_generator(self, batch: Batch, *, judged: bool) -> Loss:
        """Weigh the energy score and the penalties on bones against the critic's judgement."""
        settings = self.settings
        reactions = self.reactions(batch)
        made, every = self.generator.normalisation.reaction(reactions), reactions.flatten(0, 1)
        terms = {"symmetry": self.symmetry(every, self.weights)}
        loss = settings.symmetry_weight * terms["symmetry"]
        if judged:
            terms["judged"] = self._judge(made, batch.real).mean()
            loss = loss - terms["judged"]
        if settings.score_weight:
            u, _ = self._normalised(batch.real)
            terms["score"] = self.energy_score(made, u, self.weights, settings.score_spread).mean()
            loss = loss + settings.score_weight * terms["score"]
        if settings.bone_weight:
            terms["bones"] = self.constant_bones(every, self.weights)
            loss = loss + settings.bone_weight * terms["bones"]
        return loss, terms

    def reactions(self, batch: Batch) -> Tensor:
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
