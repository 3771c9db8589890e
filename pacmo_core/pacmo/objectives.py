"""The losses of generator and critic, all their terms in one place (PaCMO, 3.2 and 4.2)."""

from dataclasses import dataclass

import torch
from torch import Tensor

from pacmo_core.operators.quadrature import trapezoid_weights
from pacmo_core.pacmo.critic import Critic, gradient_norm
from pacmo_core.pacmo.functions import MotionPairs
from pacmo_core.pacmo.generator import Generator
from pacmo_core.pacmo.losses import ConstantBones, Symmetry
from pacmo_core.pacmo.settings import PacmoSettings

Loss = tuple[Tensor, dict[str, Tensor]]


@dataclass(frozen=True)
class Batch:
    """Some rows of a batch.

    Parameters
    ----------
    real : MotionPairs, (B, N, 3 J)
    noise : (B, k, 2 K), a generator's ``draw``
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
        c, u = self._normalised(batch.real)
        log_duration = batch.real.log_duration
        with torch.no_grad():
            fake = self.generator.normalisation.reaction(self.reaction(batch))
        real, made = self._judge(
            torch.cat([u, fake]), torch.cat([c, c]), torch.cat([log_duration, log_duration])
        ).chunk(2)
        norms = gradient_norm(
            lambda a, b: self.critic(a, b, log_duration),
            fake.lerp(u, batch.mixing),
            c,
            self.weights,
        )
        distance = real.mean() - made.mean()  # eq. 1
        penalty = (norms - 1).square().mean()  # eq. 2
        loss = self.settings.penalty_weight * penalty - distance
        return loss, {"distance": distance, "penalty": penalty, "gradient_norm": norms.mean()}

    def of_generator(self, batch: Batch) -> Loss:
        """Weigh the penalties on bones against the critic's judgement."""
        c, _ = self._normalised(batch.real)
        reaction = self.reaction(batch)
        made = self.generator.normalisation.reaction(reaction)
        judged = self._judge(made, c, batch.real.log_duration).mean()
        symmetry = self.symmetry(reaction, self.weights)
        loss = self.settings.symmetry_weight * symmetry - judged
        terms = {"judged": judged, "symmetry": symmetry}
        if self.settings.bone_weight:
            terms["bones"] = self.constant_bones(reaction, self.weights)
            loss = loss + self.settings.bone_weight * terms["bones"]
        return loss, terms

    def reaction(self, batch: Batch) -> Tensor:
        """React to the batch's partners: ``(B, N, 3 J)`` metres."""
        real = batch.real
        with self._precision():
            out: Tensor = self._react(batch.noise, real.partner, real.log_duration)
        return out.float()

    def _judge(self, u: Tensor, c: Tensor, log_duration: Tensor) -> Tensor:
        with self._precision():
            judged: Tensor = self.critic(u, c, log_duration)
        return judged.float()

    def _normalised(self, pairs: MotionPairs) -> tuple[Tensor, Tensor]:
        norm = self.generator.normalisation
        return norm.partner(pairs.partner), norm.reaction(pairs.reaction)

    def _precision(self) -> torch.autocast:
        return torch.autocast(self._device, torch.bfloat16, enabled=self._reduced)
