"""From what a network says to where joints are: plain offsets, or bones of the right length."""

import torch
from torch import Tensor, nn

from pacmo_core.skeleton import Skeleton
from pacmo_core.skeleton_prior.graph import parents_of, paths

# Metres: below this a bone's direction is left to the network.
LEAST = 1e-6


class Offsets(nn.Module):
    """The paper's form: a joint stands where the template has it, and an offset from there."""

    def forward(self, field: Tensor, template: Tensor, scales: Tensor) -> Tensor:
        """``(B, T, J, 3)`` offsets to ``(B, T, J, 3)`` places, metres."""
        del scales
        return template + field


class Tree(nn.Module):
    """Our form: forward kinematics of turned bones, so that every bone has its length exactly.

    The field is, at each joint, what is added to the unit vector of the template's bone before it
    is set to unit length again; at the root, metres to where naive scaling has it.

    Parameters
    ----------
    skeleton : Skeleton
    """

    parents: Tensor
    paths: Tensor

    def __init__(self, skeleton: Skeleton) -> None:
        super().__init__()
        self.root = skeleton.root
        self.register_buffer("parents", parents_of(skeleton), persistent=False)
        self.register_buffer("paths", paths(skeleton), persistent=False)

    def forward(self, field: Tensor, template: Tensor, scales: Tensor) -> Tensor:
        """``(B, T, J, 3)`` turns to ``(B, T, J, 3)`` places, metres.

        Parameters
        ----------
        field, template : (B, T, J, 3)
        scales : (B, J)
        """
        vectors = self.bones(template)
        lengths = vectors.norm(dim=-1, keepdim=True)
        turned = nn.functional.normalize(vectors / lengths.clamp_min(LEAST) + field, dim=-1)
        bones = turned * lengths * scales[:, None, :, None]
        return self._placed(bones, self.lifted_root(template, scales) + field[:, :, self.root])

    def naive(self, template: Tensor, scales: Tensor) -> Tensor:
        """Scale bones along their own directions: what a zero field places.

        The root stays above its place, and the lowest joint at its height.
        """
        bones = self.bones(template) * scales[:, None, :, None]
        placed = self._placed(bones, template[:, :, self.root])
        lift = template[..., 1].amin(dim=-1) - placed[..., 1].amin(dim=-1)
        return torch.stack(
            [placed[..., 0], placed[..., 1] + lift[..., None], placed[..., 2]], dim=-1
        )

    def bones(self, motion: Tensor) -> Tensor:
        """``(..., J, 3)`` vectors from each joint's parent; the root's is zero."""
        return motion - motion[..., self.parents, :]

    def lifted_root(self, template: Tensor, scales: Tensor) -> Tensor:
        """``(B, T, 3)`` metres: the root of naive scaling."""
        return self.naive(template, scales)[:, :, self.root]

    def _placed(self, bones: Tensor, root: Tensor) -> Tensor:
        at_root = torch.zeros_like(self.paths[0])
        at_root[self.root] = 1
        return self.paths @ (bones + at_root[:, None] * (root[:, :, None] - bones))
