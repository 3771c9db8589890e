"""What the kinematic model is told of each frame, in coordinates of the character's own body."""

import torch
from torch import Tensor, nn

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.skeleton_prior.kinematics import Limb
from pacmo_core.skeleton_prior.start import contact_weights
from pacmo_core.skeleton_prior.vae import CharacterInputs

# Metres: distances at which the weight of two joints is 1/e: of contact, of nearness.
RANGES = (0.15, 0.5)
# Added to the sum of a joint's weights, so that means over a partner out of range tend to zero.
NO_PARTNER = 0.1
# Metres: horizontal distance of left from right below which the heading is that of the world.
MIN_LATERAL = 1e-3
# Normalised features are clipped to so many standard deviations: what is rare in training may be
# common in use, such as contact.
MAX_DEVIATION = 5.0
# Of each joint: five vectors; for each range two vectors and a sum of weights; two scales.
PER_JOINT = 3 * (5 + 2 * len(RANGES)) + len(RANGES) + 2


class FrameFeatures(nn.Module):
    """Normalised features of each frame (B, T, F); nothing in it is trained by gradients.

    Of the pose: joint positions of character and partner from the character's root on the ground,
    velocities, and from each joint to the partner's joints near it. Per unit scale change: what
    the initial motion changes, what is known of the partner's change, by how much more the
    partner's joints near a joint move than it does, and the scales of both.
    """

    left: Tensor
    right: Tensor

    def __init__(self, skeleton: Skeleton, limbs: tuple[Limb, ...]) -> None:
        super().__init__()
        starts = {start for start, _, _ in limbs}
        pairs = [p for p in skeleton.left_right if starts & set(p)] or list(skeleton.left_right)
        left, right = torch.tensor(pairs, dtype=torch.int64).reshape(-1, 2).T
        self.root, self.size = skeleton.root, PER_JOINT * len(skeleton.joints)
        self.norm = nn.BatchNorm1d(self.size, affine=False)  # features have different units
        self.register_buffer("left", left, persistent=False)
        self.register_buffer("right", right, persistent=False)

    def forward(self, initial: Tensor, inputs: CharacterInputs, axes: Tensor) -> Tensor:
        """Compute the features, of an initial motion (B, T, J, 3) of the character."""
        template, partner, size = inputs.template, inputs.partner_template, inputs.scale_change
        on_ground = template[:, :, self.root, None] * template.new_tensor([1.0, 0.0, 1.0])
        own_change, partner_change = (initial - template) / size, (inputs.partner - partner) / size
        vectors = [
            template - on_ground,
            partner - on_ground,
            10 * torch.diff(template, dim=1, append=template[:, -1:]),
            own_change,
            partner_change,
        ]
        sums = []
        for radius in RANGES:
            weights = contact_weights(inputs.squared_distances, radius)
            total = weights.sum(dim=-1, keepdim=True)
            means = weights @ torch.cat([partner, partner_change], dim=-1)
            own = total * torch.cat([template, own_change], dim=-1)
            vectors += ((means - own) / (total + NO_PARTNER)).chunk(2, dim=-1)
            sums.append(total / (total + 1))
        local = torch.cat(vectors, dim=2) @ axes.mT
        scales = torch.stack([inputs.scales, inputs.partner_scales], dim=1).log().flatten(1)
        scales = (scales[:, None] / size[..., 0]).expand(-1, template.shape[1], -1)
        features = torch.cat([local.flatten(2), torch.cat(sums, dim=2).flatten(2), scales], dim=-1)
        normalised: Tensor = self.norm(features.flatten(0, 1)).view_as(features)
        return normalised.clamp(-MAX_DEVIATION, MAX_DEVIATION)

    def axes(self, template: Tensor) -> Tensor:
        """Compute the axes of each frame (B, T, 3, 3): left, up and forward."""
        lateral = (template[:, :, self.left] - template[:, :, self.right]).sum(dim=2)
        lateral = lateral * template.new_tensor([1.0, 0.0, 1.0])
        length = lateral.norm(dim=-1, keepdim=True)
        x = template.new_tensor([1.0, 0.0, 0.0])
        left = torch.where(length > MIN_LATERAL, lateral / length.clamp_min(MIN_LATERAL), x)
        up = template.new_tensor([0.0, 1.0, 0.0]).expand_as(left)
        return torch.stack([left, up, torch.linalg.cross(left, up)], dim=-2)
