"""What the kinematic model is told of each frame, in coordinates of the character's own body."""

import torch
from torch import Tensor, nn

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.skeleton_prior.kinematics import Limb
from pacmo_core.skeleton_prior.start import contact_weights
from pacmo_core.skeleton_prior.vae import CharacterInputs

# Metres: distance at which the contact weight of two joints has fallen to 1/e.
CONTACT_DISTANCE = 0.15
# Metres: horizontal distance of left from right below which the heading is that of the world.
MIN_LATERAL = 1e-3
# Of each joint: four vectors of the pose, contact weights, four vectors of change, two scales.
PER_JOINT = 4 * 3 + 1 + 4 * 3 + 2


class FrameFeatures(nn.Module):
    """Features of each frame (B, T, F); no weights.

    Of the pose: joint positions of character and partner from the character's root on the ground,
    velocities, and from each joint to the partner's joints in contact. Per unit scale change: what
    the initial motion changes, what is known of the partner's change, the residual of the contacts,
    and the scales of both.
    """

    left: Tensor
    right: Tensor

    def __init__(self, skeleton: Skeleton, limbs: tuple[Limb, ...]) -> None:
        super().__init__()
        starts = {start for start, _, _ in limbs}
        pairs = [p for p in skeleton.left_right if starts & set(p)] or list(skeleton.left_right)
        left, right = torch.tensor(pairs, dtype=torch.int64).reshape(-1, 2).T
        self.root, self.size = skeleton.root, PER_JOINT * len(skeleton.joints)
        self.register_buffer("left", left, persistent=False)
        self.register_buffer("right", right, persistent=False)

    def forward(self, initial: Tensor, inputs: CharacterInputs, axes: Tensor) -> Tensor:
        """Compute the features, of an initial motion (B, T, J, 3) of the character."""
        template, partner, size = inputs.template, inputs.partner_template, inputs.scale_change
        on_ground = template[:, :, self.root, None] * template.new_tensor([1.0, 0.0, 1.0])
        velocity = 10 * torch.diff(template, dim=1, append=template[:, -1:])
        weights = contact_weights(template, partner, CONTACT_DISTANCE)
        total = weights.sum(dim=-1, keepdim=True)
        own_change = (initial - template) / size
        partner_change = (inputs.partner - partner) / size
        vectors = [
            template - on_ground,
            partner - on_ground,
            velocity,
            weights @ partner - total * template,
            own_change,
            partner_change,
            weights @ partner_change - total * own_change,
            (weights @ partner_change) / (total + 0.1),
        ]
        local = torch.cat(vectors, dim=2) @ axes.mT
        scales = torch.stack([inputs.scales, inputs.partner_scales], dim=1).log().flatten(1)
        scales = (scales[:, None] / size[..., 0]).expand(-1, template.shape[1], -1)
        return torch.cat([local.flatten(2), total.flatten(2), scales], dim=-1)

    def axes(self, template: Tensor) -> Tensor:
        """Compute the axes of each frame (B, T, 3, 3): left, up and forward."""
        lateral = (template[:, :, self.left] - template[:, :, self.right]).sum(dim=2)
        lateral = lateral * template.new_tensor([1.0, 0.0, 1.0])
        length = lateral.norm(dim=-1, keepdim=True)
        x = template.new_tensor([1.0, 0.0, 0.0])
        left = torch.where(length > MIN_LATERAL, lateral / length.clamp_min(MIN_LATERAL), x)
        up = template.new_tensor([0.0, 1.0, 0.0]).expand_as(left)
        return torch.stack([left, up, torch.linalg.cross(left, up)], dim=-2)
