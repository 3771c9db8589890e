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

import torch
from torch import Tensor

from pacmo_core.skeleton_prior.kinematics import KinematicOutput
from pacmo_core.skeleton_prior.settings import StartSettings


def squared_distances(character: Tensor, partner: Tensor) -> Tensor:
    """Compute squared distances of the joints of (..., J, 3), metres: (..., J, J)."""
    squares = character.square().sum(-1)[..., :, None] + partner.square().sum(-1)[..., None, :]
    return (squares - 2 * character @ partner.mT).clamp_min(0)


def contact_weights(squares: Tensor, contact_range: float) -> Tensor:
    """Weigh pairs by squared distance (...): 1 in contact, 1/e at ``contact_range``."""
    return torch.exp(squares * (-1 / contact_range**2))


def ground_weights(ends: Tensor, height: float) -> Tensor:
    """Weigh limb ends ``(..., L, 3)`` by height above the frame's lowest one: ``(..., L, 1)``.

    The lowest is taken to be on the ground: where cameras estimated the floor, it is not the same
    for both people, nor everywhere.
    """
    heights = ends[..., 1:2] - ends[..., 1:2].amin(dim=-2, keepdim=True)
    return torch.exp(-((heights / height) ** 2))


def initial_output(
    kinematics: KinematicOutput,
    settings: StartSettings,
    character: tuple[Tensor, Tensor],
    partner: tuple[Tensor, Tensor] | None,
    *,
    partner_yields: bool = False,
) -> Tensor:
    """Compute the output of ``KinematicOutput`` that the rule asks for, (B, T, J, 3).

    Parameters
    ----------
    character : template (B, T, J, 3), metres, and bone scales (B, J)
    partner : squared distances of the template's joints to the partner's (B, T, J, J), and the
        change of the partner (B, T, J, 3), metres; None for a character alone
    partner_yields : whether the partner's change is a guess that contacts will correct
    """
    template, scales = character
    change = kinematics.scaled_posture(template, scales) - template
    vertical = template.new_tensor([0.0, 1.0, 0.0])
    ends = kinematics.limbs[:, 2]
    ground = ground_weights(template[:, :, ends], settings.ground_height) * vertical
    stiffness = settings.root + settings.ground * ground.sum(dim=2)
    pull = -settings.ground * (ground * change[:, :, ends]).sum(dim=2)
    if partner is None:
        shift = pull / stiffness
        moved = change[:, :, ends] + shift[:, :, None]
        reach = -settings.foot * ground * moved / (1 + settings.foot * ground)
        return _at_limb_ends(kinematics, shift, reach)

    weights = contact_weights(partner[0], settings.contact_range)
    demand, asked = weights @ partner[1], weights.sum(dim=-1, keepdim=True)
    share = settings.yielding if partner_yields else 1.0
    contact, hand = share * settings.contact, share * settings.hand
    pull = pull + contact * (demand - asked * change).sum(dim=2)
    shift = pull / (stiffness + contact * asked.sum(dim=2))

    moved = change + shift[:, :, None]
    below = kinematics.ancestor_matrix[:, ends].T  # (L, J): 1 at a limb's end and beyond it
    left = hand * (below @ (demand - asked * moved)) - settings.foot * ground * moved[:, :, ends]
    reach = left / (1 + hand * (below @ asked) + settings.foot * ground)
    return _at_limb_ends(kinematics, shift, reach)


def _at_limb_ends(kinematics: KinematicOutput, shift: Tensor, reach: Tensor) -> Tensor:
    """Move the root by ``shift`` (B, T, 3), and limb ends by ``reach`` (B, T, L, 3) more."""
    joints = len(kinematics.ancestor_matrix)
    output = shift.new_zeros((*shift.shape[:2], joints, 3))
    output[:, :, kinematics.root] = shift
    output[:, :, kinematics.limbs[:, 2]] = shift[:, :, None] + reach
    return output


def stand(
    kinematics: KinematicOutput, settings: StartSettings, template: Tensor, scales: Tensor
) -> Tensor:
    """Apply the rule to a character alone: (B, T, J, 3), metres."""
    output = initial_output(kinematics, settings, (template, scales), None)
    motion: Tensor = kinematics(output, template, scales)
    return motion
