"""From what a network says to where joints are: plain offsets, or bones of the right length."""

import torch
from torch import Tensor, nn

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.skeleton_prior.graph import parents_of, paths
from pacmo_core.skeleton_prior.limbs import (
    Limb,
    along,
    bend,
    mean_of_standing,
    settling,
    standing,
    stiffness,
)
from pacmo_core.skeleton_prior.products import over_joints

# Metres: below this a bone's direction is left to the network.
LEAST = 1e-6
# Share of what limbs of other lengths would ask for, were they to keep their angles, that they get:
# for the rest they bend.
KEPT = 0.3


class Offsets(nn.Module):
    """The paper's form: a joint stands where the template has it, and an offset from there."""

    def forward(self, field: Tensor, template: Tensor, scales: Tensor) -> Tensor:
        """``(B, T, J, 3)`` offsets to ``(B, T, J, 3)`` places, metres."""
        del scales
        return template + field


class Tree(nn.Module):
    """Our form: forward kinematics, so that every bone has its length exactly.

    The field says, at the root and at the ends of limbs, by how many metres to stand elsewhere than
    guessed; at other joints, what is added to the unit vector of the bone, or of the side to which
    a limb bends, before it is set to unit length again. Limbs then reach for their ends, so a body
    that moves keeps its feet where they stand. The guess is what no field gives: the template with
    the trunk about its place, hands and feet in theirs, as far as limbs reach.

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
        """``(B, T, J, 3)`` to ``(B, T, J, 3)`` places, metres.

        Parameters
        ----------
        field, template : (B, T, J, 3)
        scales : (B, J)
        """
        bones = self.bones(template) * scales[:, None, :, None]
        root = template[:, :, self.root] + self._settled(bones, template) + field[:, :, self.root]
        lengths = bones.norm(dim=-1, keepdim=True)
        bones = nn.functional.normalize(bones / lengths.clamp_min(LEAST) + field, dim=-1) * lengths
        return self._placed(self._reaching(bones, root, field, template), root)

    def guess(self, template: Tensor, scales: Tensor) -> Tensor:
        """Place what a zero field places, (B, T, J, 3) metres; at scale 1 that is the template."""
        return self.forward(torch.zeros_like(template), template, scales)

    def starting_field(self, shift: Tensor, template: Tensor, scales: Tensor) -> Tensor:
        """Give the field from which a network starts: what the mesh asks of a body as a whole.

        The trunk goes where the partner asks it to, but for what legs that stand resist, and some
        of the way to where these would keep their angles: the more, the straighter they are; and no
        further from the ground than they reach. An end that does not stand is tied to its own arm
        as much as to the partner, so it goes half with each, and some of the way to where its arm
        would keep its angles.

        Parameters
        ----------
        shift : (B, T, 3), metres: what the partner asks for
        template : (B, T, J, 3), metres
        scales : (B, J)

        Returns
        -------
        (B, T, J, 3)
        """
        starts, middles, ends = self.limbs.T
        before = self.bones(template)
        bones = before * scales[:, None, :, None]
        root = template[:, :, self.root] + self._settled(bones, template)
        raised = (self._placed(bones, root) - template)[:, :, starts]
        longer = (bones - before)[:, :, middles] + (bones - before)[:, :, ends]
        bent = raised + longer
        limbs = (template[:, :, joints] for joints in (starts, middles, ends))
        axis, stiff = stiffness(*limbs, asked=shift[:, :, None] + bent)
        resisted = along((KEPT + (1 - KEPT) * stiff) * bent + stiff * shift[:, :, None], axis)
        gone = shift - mean_of_standing(resisted, template[:, :, ends])
        hips = self._placed(bones, root + gone)[:, :, starts]
        field = torch.zeros_like(template)
        field[:, :, self.root] = gone + settling(hips, template[:, :, ends], self._reach(bones))
        carried = (self.forward(field, template, scales) - template)[:, :, starts]
        free = 1 - standing(template[:, :, ends])
        field[:, :, ends] = free * ((shift[:, :, None] + carried) / 2 + KEPT * longer)
        return field

    def bones(self, motion: Tensor) -> Tensor:
        """``(..., J, 3)`` vectors from each joint's parent; the root's is zero."""
        return motion - motion[..., self.parents, :]

    def _settled(self, bones: Tensor, template: Tensor) -> Tensor:
        """Guess how far the root moves, (B, T, 3) metres: the trunk about its place, legs on it."""
        if not len(self.limbs):
            return torch.zeros_like(template[:, :, 0])
        starts, _, ends = self.limbs.T
        placed = self._placed(bones, template[:, :, self.root])
        centred = (template - placed)[:, :, self.trunk].mean(dim=2)
        start = (placed + centred[:, :, None])[:, :, starts]
        return centred + settling(start, template[:, :, ends], self._reach(bones))

    def _reaching(self, bones: Tensor, root: Tensor, field: Tensor, template: Tensor) -> Tensor:
        """Let limbs reach for their ends: bones (B, T, J, 3) to the same, of their lengths."""
        if not len(self.limbs):
            return bones
        starts, middles, ends = self.limbs.T
        placed = self._placed(bones, root)
        way = (template + field)[:, :, ends] - placed[:, :, starts]
        side = template[:, :, middles] - (template[:, :, starts] + template[:, :, ends]) / 2
        side = nn.functional.normalize(side, dim=-1) + field[:, :, middles]
        upper, lower = bones[:, :, middles].norm(dim=-1), bones[:, :, ends].norm(dim=-1)
        first, second = bend(way, upper, lower, side)
        return bones.index_copy(2, middles, first).index_copy(2, ends, second)

    def _reach(self, bones: Tensor) -> Tensor:
        _, middles, ends = self.limbs.T
        reach: Tensor = bones[:, :, middles].norm(dim=-1) + bones[:, :, ends].norm(dim=-1)
        return reach

    def _placed(self, bones: Tensor, root: Tensor) -> Tensor:
        at_root = torch.zeros_like(self.paths[0])
        at_root[self.root] = 1
        return over_joints(self.paths, bones + at_root[:, None] * (root[:, :, None] - bones))
