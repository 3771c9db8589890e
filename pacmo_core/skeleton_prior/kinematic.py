"""Our form: turns of bones, linear in the change of the bodies, from what the mesh would pull.

Unlike the paper, whose decoders see both ends of the template and the partner as one code, every
frame is told its template, where the body starts from, and how that breaks the relations to
the partner. All of it is known beforehand: nothing is fed back, and of a frame's way the recurrence
alone waits for the frame before.
"""

import torch
from torch import Tensor, nn

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.skeleton_prior.character import Character, Code, Gaussian, Given
from pacmo_core.skeleton_prior.encoders import MotionEncoder, ends, widths
from pacmo_core.skeleton_prior.graph import adjacency, neighbours
from pacmo_core.skeleton_prior.layers import (
    ChannelNorm,
    Dense,
    Head,
    Silent,
    StGcn,
    by_frame,
    by_row,
)
from pacmo_core.skeleton_prior.limbs import Limb
from pacmo_core.skeleton_prior.placing import LEAST, Tree
from pacmo_core.skeleton_prior.products import over_joints
from pacmo_core.skeleton_prior.recurrence import GraphGru
from pacmo_core.skeleton_prior.relations import pulls

# Channels of ``KinematicCharacter.sights``.
SIGHTS = 30
# The least change of bodies that is told apart from none.
SMALLEST = 1e-3
# A field for a change of 1: a network's output is of order 1.
GAIN = 0.3
# Frames that the head sees at once: of all of them its layers would leave the processor's cache.
AT_ONCE = 4


class KinematicDecoder(nn.Module):
    """From what is known of every joint in every frame, and a latent, to a field.

    Parameters
    ----------
    skeleton : Skeleton
    hidden : channels
    """

    def __init__(self, skeleton: Skeleton, *, hidden: int) -> None:
        super().__init__()
        links = neighbours(skeleton)
        # Channels have units of their own; the recurrence wants them alike.
        self.alike = ChannelNorm(SIGHTS)
        self.lifting = Dense(SIGHTS, hidden)
        self.whole = Dense(SIGHTS, hidden, bias=False)
        self.around = nn.ModuleList(
            [StGcn(links, hidden, hidden, stride=1, dropout=0.0, residual=True) for _ in range(2)]
        )
        self.recurrent = GraphGru(adjacency(skeleton), hidden, hidden)
        self.head = Head(2 * hidden, 3, last=Silent)

    def forward(self, sights: Tensor, latent: Tensor) -> Tensor:
        """``(B, T, J, 30)`` and ``(B, J, h)`` to ``(B, T, J, 3)``."""
        known = self.alike(by_frame(sights))
        seen = self.lifting(known) + self.whole(known.mean(dim=1, keepdim=True))
        for layer in self.around:
            seen = layer(seen, None)
        states = self.recurrent(seen, latent.transpose(0, 1).contiguous())
        parts = zip(states.split(AT_ONCE), seen.split(AT_ONCE), strict=True)
        return by_row(torch.cat([self.head(*pair) for pair in parts]))


class KinematicCharacter(Character):
    """A character whose bones are right by construction; both characters are built alike.

    Parameters
    ----------
    skeleton : Skeleton
    limbs : its arms and legs
    hidden : channels
    dropout : share, of the encoder
    """

    def __init__(
        self, skeleton: Skeleton, limbs: tuple[Limb, ...], *, hidden: int, dropout: float
    ) -> None:
        super().__init__()
        self.hidden = hidden
        self.place = self.tree = Tree(skeleton, limbs)
        self.encoder = MotionEncoder(neighbours(skeleton), 4, widths(hidden), dropout=dropout)
        self.code = Gaussian(hidden + 6, hidden)
        self.decoder = KinematicDecoder(skeleton, hidden=hidden)

    def latent_shape(self, given: Given) -> tuple[int, ...]:
        """One code a joint."""
        rows, _, joints, _ = given.template.shape
        return (rows, joints, self.hidden)

    def encode(self, motion: Tensor, given: Given, random: torch.Generator | None) -> Code:
        """Encode what the start does not explain."""
        size = amplitude(given)
        change = (motion - given.starting_motion) / (size * GAIN)
        grown = self._grown(given.scales, size)[:, None].expand(-1, motion.shape[1], -1, -1)
        encoded = self.encoder(torch.cat([change, grown], dim=-1), random)
        code: Code = self.code(torch.cat([encoded, ends(given.template)], dim=-1))
        return code

    def decode(self, latent: Tensor, given: Given) -> Tensor:
        """Turn bones by so much as the bodies change."""
        field: Tensor = self.decoder(self.sights(given), latent)
        return given.starting_field + field * (GAIN * amplitude(given))

    def sights(self, given: Given) -> Tensor:
        """Say all that is known of a joint in a frame, (B, T, J, 30); changes for a change of 1."""
        template, size = given.template, amplitude(given)
        own_change = given.starting_motion - template
        partner_change = given.partner - given.partner_template
        near = pulls(template, given.partner_template, own_change / size, partner_change / size)
        bones = self.tree.bones(template)
        directions = bones / bones.norm(dim=-1, keepdim=True).clamp_min(LEAST)
        grown = torch.cat(
            [
                self._grown(given.scales, size),
                self._grown(given.partner_scales, size)
                .mean(dim=1, keepdim=True)
                .expand(-1, template.shape[2], -1),
            ],
            dim=-1,
        )
        # What a change of each bone vector would move: the gradients of those energies by bones.
        pulled = torch.cat([own_change / size, near[..., :6]], dim=-1)
        borne = over_joints(self.tree.paths.T, pulled)
        speed = torch.diff(template, dim=1, append=template[:, -1:]).norm(dim=-1, keepdim=True)
        constant = grown[:, None].expand(-1, template.shape[1], -1, -1)
        parts = [
            constant,
            own_change / size,
            near,
            directions,
            template[..., 1:2],
            10 * speed,
            bones.norm(dim=-1, keepdim=True),
            borne / template.shape[2],
        ]
        return torch.cat(parts, dim=-1)

    def _grown(self, scales: Tensor, size: Tensor) -> Tensor:
        return (scales.log() / size[:, 0, :, 0])[..., None]


def amplitude(given: Given) -> Tensor:
    """``(B, 1, 1, 1)``: how much both bodies change: root mean square of bones' logarithms."""
    both = torch.cat([given.scales, given.partner_scales], dim=1)
    size = both.log().square().mean(dim=1).sqrt()
    return size.clamp_min(SMALLEST)[:, None, None, None]
