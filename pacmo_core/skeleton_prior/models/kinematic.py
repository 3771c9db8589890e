"""Our form: turns of bones, linear in the change of the bodies, from what the mesh would pull.

Unlike the paper, whose decoders see both ends of the template and the partner as one code, every
frame is told its template, where the body starts from, and how that breaks the relations to
the partner. All of it is known beforehand: nothing is fed back, and of a frame's way the recurrence
alone waits for the frame before.
"""

import torch
from torch import Tensor, nn

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.skeleton_prior.autograd_functions import multiply_joints
from pacmo_core.skeleton_prior.kinematics import (
    MIN_BONE_LENGTH,
    KinematicOutput,
    Limb,
    mesh_residual_features,
)
from pacmo_core.skeleton_prior.layers import (
    ChannelBatchNorm,
    ConcatLinear,
    GraphGru,
    OutputHead,
    StGcnEncoder,
    StGcnLayer,
    ZeroInitLinear,
    adjacency,
    batch_first,
    encoder_channels,
    end_poses,
    frames_first,
    off_diagonal_adjacency,
)
from pacmo_core.skeleton_prior.settings import PriorConfig
from pacmo_core.skeleton_prior.vae import (
    CharacterInputs,
    CharacterVae,
    DiagonalGaussian,
    GaussianHead,
    SkeletonPrior,
)

# With its joint features the model needs a quarter of the paper's channels.
HIDDEN_DIVISOR, MIN_HIDDEN = 4, 16
# Channels of ``KinematicVae.sights``.
N_JOINT_FEATURES = 30
# The least change of bodies that is told apart from none.
MIN_SKELETON_CHANGE = 1e-3
# A field for a change of 1: a network's output is of order 1.
OUTPUT_GAIN = 0.3
# Frames that the head sees at once: of all of them its layers would leave the processor's cache.
HEAD_FRAMES = 4


class KinematicDecoder(nn.Module):
    """From what is known of every joint in every frame, and a latent, to a field.

    Parameters
    ----------
    skeleton : Skeleton
    hidden : channels
    """

    def __init__(self, skeleton: Skeleton, *, hidden: int) -> None:
        super().__init__()
        links = off_diagonal_adjacency(skeleton)
        # Channels have units of their own; the recurrence wants them alike.
        self.alike = ChannelBatchNorm(N_JOINT_FEATURES)
        self.lifting = ConcatLinear(N_JOINT_FEATURES, hidden)
        self.whole = ConcatLinear(N_JOINT_FEATURES, hidden, bias=False)
        self.around = nn.ModuleList(
            [
                StGcnLayer(links, hidden, hidden, stride=1, dropout=0.0, residual=True)
                for _ in range(2)
            ]
        )
        self.recurrent = GraphGru(adjacency(skeleton), hidden, hidden)
        self.head = OutputHead(2 * hidden, 3, last=ZeroInitLinear)

    def forward(self, sights: Tensor, latent: Tensor) -> Tensor:
        """``(B, T, J, 30)`` and ``(B, J, h)`` to ``(B, T, J, 3)``."""
        known = self.alike(frames_first(sights))
        seen = self.lifting(known) + self.whole(known.mean(dim=1, keepdim=True))
        for layer in self.around:
            seen = layer(seen, None)
        states = self.recurrent(seen, latent.transpose(0, 1).contiguous())
        parts = zip(states.split(HEAD_FRAMES), seen.split(HEAD_FRAMES), strict=True)
        return batch_first(torch.cat([self.head(*pair) for pair in parts]))


class KinematicVae(CharacterVae):
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
        self.place = self.tree = KinematicOutput(skeleton, limbs)
        self.encoder = StGcnEncoder(
            off_diagonal_adjacency(skeleton), 4, encoder_channels(hidden), dropout=dropout
        )
        self.code = GaussianHead(hidden + 6, hidden)
        self.decoder = KinematicDecoder(skeleton, hidden=hidden)

    def latent_shape(self, given: CharacterInputs) -> tuple[int, ...]:
        """One code a joint."""
        rows, _, joints, _ = given.template.shape
        return (rows, joints, self.hidden)

    def encode(
        self, motion: Tensor, given: CharacterInputs, random: torch.Generator | None
    ) -> DiagonalGaussian:
        """Encode what the start does not explain."""
        size = skeleton_change(given)
        change = (motion - given.starting_motion) / (size * OUTPUT_GAIN)
        grown = self._grown(given.scales, size)[:, None].expand(-1, motion.shape[1], -1, -1)
        encoded = self.encoder(torch.cat([change, grown], dim=-1), random)
        code: DiagonalGaussian = self.code(torch.cat([encoded, end_poses(given.template)], dim=-1))
        return code

    def decode(self, latent: Tensor, given: CharacterInputs) -> Tensor:
        """Turn bones by so much as the bodies change."""
        field: Tensor = self.decoder(self.sights(given), latent)
        return given.starting_field + field * (OUTPUT_GAIN * skeleton_change(given))

    def sights(self, given: CharacterInputs) -> Tensor:
        """Say all that is known of a joint in a frame, (B, T, J, 30); changes for a change of 1."""
        template, size = given.template, skeleton_change(given)
        own_change = given.starting_motion - template
        partner_change = given.partner - given.partner_template
        near = mesh_residual_features(
            template, given.partner_template, own_change / size, partner_change / size
        )
        bones = self.tree.bones(template)
        directions = bones / bones.norm(dim=-1, keepdim=True).clamp_min(MIN_BONE_LENGTH)
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
        borne = multiply_joints(self.tree.ancestor_matrix.T, pulled)
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


def skeleton_change(given: CharacterInputs) -> Tensor:
    """``(B, 1, 1, 1)``: how much both bodies change: root mean square of bones' logarithms."""
    both = torch.cat([given.scales, given.partner_scales], dim=1)
    size = both.log().square().mean(dim=1).sqrt()
    return size.clamp_min(MIN_SKELETON_CHANGE)[:, None, None, None]


def build(config: PriorConfig) -> SkeletonPrior:
    """Build the model: both characters alike, the output layer with inverse kinematics of limbs."""
    hidden = max(MIN_HIDDEN, config.hidden // HIDDEN_DIVISOR)
    first, second = (
        KinematicVae(config.skeleton, config.limbs, hidden=hidden, dropout=config.dropout)
        for _ in range(2)
    )
    return SkeletonPrior(config, (first, second), both_roles=True)
