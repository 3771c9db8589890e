"""From what a network says to where joints are: plain offsets, or bones of the right length."""

import torch
from torch import Tensor, nn

from pacmo_core.skeleton import Skeleton
from pacmo_core.skeleton_prior.graph import parents_of, paths
from pacmo_core.skeleton_prior.limbs import Limb, bend, settling

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

    The field is, at each joint, what is added to the unit vector of a guess at its bone before it
    is set to unit length again; at the root, metres from the guess. The guess is the template with
    the trunk about its place, hands and feet in theirs, as far as limbs reach: ``guess``.

    Parameters
    ----------
    skeleton : Skeleton
    limbs : its arms and legs
    """

    parents: Tensor
    paths: Tensor
    limbs: Tensor
    trunk: Tensor

    def __init__(self, skeleton: Skeleton, limbs: tuple[Limb, ...]) -> None:
        super().__init__()
        self.root = skeleton.root
        self.register_buffer("parents", parents_of(skeleton), persistent=False)
        self.register_buffer("paths", paths(skeleton), persistent=False)
        index = torch.tensor(limbs, dtype=torch.int64).reshape(-1, 3)
        self.register_buffer("limbs", index, persistent=False)
        # The trunk: what no limb's two bones carry.
        carried = self.paths[:, index[:, 1]].sum(dim=1) > 0
        self.register_buffer("trunk", torch.nonzero(~carried)[:, 0], persistent=False)

    def forward(self, field: Tensor, template: Tensor, scales: Tensor) -> Tensor:
        """``(B, T, J, 3)`` turns to ``(B, T, J, 3)`` places, metres.

        Parameters
        ----------
        field, template : (B, T, J, 3)
        scales : (B, J)
        """
        bones, root = self._guessed(template, scales)
        lengths = self._lengths(template) * scales[:, None, :, None]
        turned = nn.functional.normalize(bones / lengths.clamp_min(LEAST) + field, dim=-1)
        return self._placed(turned * lengths, root + field[:, :, self.root])

    def guess(self, template: Tensor, scales: Tensor) -> Tensor:
        """Place what a zero field places, (B, T, J, 3) metres; at scale 1 that is the template."""
        return self._placed(*self._guessed(template, scales))

    def naive(self, template: Tensor, scales: Tensor) -> Tensor:
        """Scale bones along their own directions, each body for itself: what guesses must beat.

        The root stays above its place, and the lowest joint at its height.
        """
        bones = self.bones(template) * scales[:, None, :, None]
        placed = self._placed(bones, template[:, :, self.root])
        lift = template[..., 1].amin(dim=-1) - placed[..., 1].amin(dim=-1)
        up = torch.tensor([0.0, 1.0, 0.0], device=template.device)
        return placed + lift[..., None, None] * up

    def bones(self, motion: Tensor) -> Tensor:
        """``(..., J, 3)`` vectors from each joint's parent; the root's is zero."""
        return motion - motion[..., self.parents, :]

    def _lengths(self, motion: Tensor) -> Tensor:
        lengths: Tensor = self.bones(motion).norm(dim=-1, keepdim=True)
        return lengths

    def _guessed(self, template: Tensor, scales: Tensor) -> tuple[Tensor, Tensor]:
        """Guess bones (B, T, J, 3) and the root's place (B, T, 3), metres."""
        bones = self.bones(template) * scales[:, None, :, None]
        root = template[:, :, self.root]
        if not len(self.limbs):
            return bones, root
        starts, middles, ends = self.limbs.T
        upper, lower = bones[:, :, middles].norm(dim=-1), bones[:, :, ends].norm(dim=-1)
        placed = self._placed(bones, root)
        centred = (template - placed)[:, :, self.trunk].mean(dim=2)
        root, placed = root + centred, placed + centred[:, :, None]
        moved = settling(placed[:, :, starts], template[:, :, ends], upper + lower)
        way = template[:, :, ends] - placed[:, :, starts] - moved[:, :, None]
        side = template[:, :, middles] - (template[:, :, starts] + template[:, :, ends]) / 2
        first, second = bend(way, upper, lower, side)
        bones = bones.index_copy(2, middles, first).index_copy(2, ends, second)
        return bones, root + moved

    def _placed(self, bones: Tensor, root: Tensor) -> Tensor:
        at_root = torch.zeros_like(self.paths[0])
        at_root[self.root] = 1
        return self.paths @ (bones + at_root[:, None] * (root[:, :, None] - bones))
