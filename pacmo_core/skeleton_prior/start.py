"""The start: a rule that retargets without training, and that the kinematic model adds to.

A rule of three sentences, each a closed form of the InteractionMesh energy with the posture fixed.

1. **Posture.** Every bone keeps its direction and takes its new length.
2. **Body.** The body as a whole moves to where limb ends near the ground keep their height, and
   joints in contact their place beside the partner's: a mean of these demands, and of no movement,
   weighted by ``ground`` and ``contact`` against ``root``. Sideways only contacts count.
3. **Limbs.** Hands and feet then close what is left of these demands, weighted by ``foot`` and
   ``hand`` against 1 for the posture; inverse kinematics bends the limbs.

The first character does not know the second's motion. It expects its partner where the ground alone
would have it (``stand``), and leaves part of what contacts demand to it: their weights are
multiplied by ``yielding``. The second character closes the rest.

The settings (``StartSettings``) are chosen on training variations: ``benchmarks.start_settings``.
"""

from dataclasses import replace

import torch
from torch import Tensor

from pacmo_core.skeleton_prior.kinematics import KinematicOutput
from pacmo_core.skeleton_prior.settings import StartSettings


def contact_weights(character: Tensor, partner: Tensor, contact_range: float) -> Tensor:
    """Weigh pairs of joints by proximity, (..., J, J): 1 in contact, 1/e at ``contact_range``."""
    return torch.exp(-((torch.cdist(character, partner) / contact_range) ** 2))


def ground_weights(ends: Tensor, height: float) -> Tensor:
    """Weigh limb ends ``(..., L, 3)`` by height above the ground: ``(..., L, 1)``, 1 on it."""
    return torch.exp(-((ends[..., 1:2].clamp_min(0) / height) ** 2))


def initial_output(
    kinematics: KinematicOutput,
    settings: StartSettings,
    character: tuple[Tensor, Tensor],
    partner: tuple[Tensor, Tensor],
    *,
    partner_yields: bool,
) -> Tensor:
    """Compute the output of ``KinematicOutput`` that the rule asks for, (B, T, J, 3).

    Parameters
    ----------
    character : template (B, T, J, 3), metres, and bone scales (B, J)
    partner : template and motion, (B, T, J, 3), metres
    partner_yields : whether the partner's motion is a guess that contacts will change
    """
    template, scales = character
    change = kinematics.scaled_posture(template, scales) - template
    vertical = template.new_tensor([0.0, 1.0, 0.0])
    ends = kinematics.limbs[:, 2]
    ground = ground_weights(template[:, :, ends], settings.ground_height) * vertical
    weights = contact_weights(template, partner[0], settings.contact_range)
    demand = weights @ (partner[1] - partner[0])
    asked = weights.sum(dim=-1, keepdim=True)

    share = settings.yielding if partner_yields else 1.0
    contact, hand = share * settings.contact, share * settings.hand
    stiffness = settings.root + settings.ground * ground.sum(dim=2) + contact * asked.sum(dim=2)
    pull = contact * (demand - asked * change).sum(dim=2)
    shift = (pull - settings.ground * (ground * change[:, :, ends]).sum(dim=2)) / stiffness

    moved = change + shift[:, :, None]
    below = kinematics.ancestor_matrix[:, ends].T  # (L, J): 1 at a limb's end and beyond it
    left = hand * (below @ (demand - asked * moved)) - settings.foot * ground * moved[:, :, ends]
    reach = left / (1 + hand * (below @ asked) + settings.foot * ground)

    output = torch.zeros_like(template)
    output[:, :, kinematics.root] = shift
    output[:, :, ends] = shift[:, :, None] + reach
    return output


def stand(
    kinematics: KinematicOutput, settings: StartSettings, template: Tensor, scales: Tensor
) -> Tensor:
    """Apply the rule to a character alone: (B, T, J, 3), metres."""
    alone = replace(settings, contact=0.0, hand=0.0)
    output = initial_output(
        kinematics, alone, (template, scales), (template, template), partner_yields=False
    )
    motion: Tensor = kinematics(output, template, scales)
    return motion
