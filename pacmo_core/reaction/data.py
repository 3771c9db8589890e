"""Interactions as training data: pairs of functions of normalised time, and their augmentation.

Each interaction is transformed to the frame of the partner's first pose and sampled at N evenly
spaced times in [0, 1]. Augmentation mirrors, scales and rotates both people, lowers the partner's
frame rate, changes the tempo, and moves the partner's joints as another skeleton or a sensor would.
So the partners of other captures, whose joints lie elsewhere in the body, are less strange.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from scipy.interpolate import CubicSpline
from torch import Tensor

from pacmo_core.data.interaction import Interaction, Motion
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.data.transforms import body_frame
from pacmo_core.operators.spline import Spline
from pacmo_core.reaction.settings import AugmentationSettings, PartsSettings


@dataclass(frozen=True)
class Condition:
    """What a reaction is generated from.

    Parameters
    ----------
    partner : (B, T, 3 J) float32, metres, in the partner's first frame
    log_duration : (B,) float32, logarithm of seconds
    action : (B,) int64, indices of action labels; zeros where labels are no condition
    """

    partner: Tensor
    log_duration: Tensor
    action: Tensor


@dataclass(frozen=True)
class MotionPairs:
    """Partner and reaction at N evenly spaced times in [0, 1], in the partner's first frame.

    Parameters
    ----------
    partner, reaction : (B, N, 3 J) float32, metres
    log_duration : (B,) float32, logarithm of seconds
    action : (B,) int64, indices of action labels; zeros where labels are no condition
    """

    partner: Tensor
    reaction: Tensor
    log_duration: Tensor
    action: Tensor

    def __len__(self) -> int:
        return len(self.partner)

    def __getitem__(self, rows: Tensor | slice) -> "MotionPairs":
        return self._map(lambda part: part[rows])

    @property
    def condition(self) -> Condition:
        """All but the reaction."""
        return Condition(self.partner, self.log_duration, self.action)

    def repeat(self, n: int) -> "MotionPairs":
        """Concatenate n copies."""
        return self._map(lambda part: part.repeat(n, *[1] * (part.ndim - 1)))

    def to(self, device: str | torch.device) -> "MotionPairs":
        """Move to a device."""
        return self._map(lambda part: part.to(device))

    def _map(self, function: Callable[[Tensor], Tensor]) -> "MotionPairs":
        return MotionPairs(*map(function, vars(self).values()))


def sample_motion_pairs(
    interactions: Sequence[Interaction], n_points: int, action: Tensor | None = None
) -> MotionPairs:
    """Sample each interaction on one grid: ``person_a`` is the partner, ``person_b`` reacts.

    Parameters
    ----------
    interactions : B of them
    n_points : N
    action : (B,) int64, indices of their labels, if labels are a condition

    Raises
    ------
    ValueError
        If there are none, or their skeletons differ.
    """
    check_common_skeleton(interactions)
    sampled = [_sample_pair(interaction, n_points) for interaction in interactions]
    # Copied into torch's memory: rounding of products depends on alignment, which varies in NumPy.
    return MotionPairs(
        partner=torch.tensor(np.stack([partner for partner, _ in sampled])),
        reaction=torch.tensor(np.stack([reaction for _, reaction in sampled])),
        log_duration=torch.tensor([np.log(i.duration) for i in interactions], dtype=torch.float32),
        action=torch.zeros(len(interactions), dtype=torch.long) if action is None else action,
    )


def expand_directions(interactions: Sequence[Interaction], *, both: bool) -> list[Interaction]:
    """List interactions and, if ``both``, each again with its people exchanged (PaCMO, 3.1)."""
    return [*interactions, *(i.swapped() for i in interactions if both)]


MIN_PART_FRAMES = 8  # a quarter of a second at 30 frames a second: less hardly is a motion


def with_random_parts(
    interactions: Sequence[Interaction], settings: PartsSettings
) -> list[Interaction]:
    """List interactions and random parts of each: people in the middle of what they do.

    Captures begin and end anywhere. A model of whole actions alone takes each for a whole one, and
    in a part of a second makes all of it.

    Parameters
    ----------
    interactions : N of them
    settings : PartsSettings

    Returns
    -------
    (1 + ``n``) N interactions: the whole ones, a part of each, then the next of each
    """
    random = np.random.default_rng(settings.random_seed)
    parts = [
        _random_part(interaction, settings, random)
        for _ in range(settings.n)
        for interaction in interactions
    ]
    return [*interactions, *parts]


def _random_part(
    interaction: Interaction, settings: PartsSettings, random: np.random.Generator
) -> Interaction:
    n_frames = len(interaction.times)
    length = round(random.uniform(settings.min_share, settings.max_share) * n_frames)
    length = min(max(MIN_PART_FRAMES, length), n_frames)
    first = int(random.integers(0, n_frames - length + 1))
    rows = slice(first, first + length)
    return replace(
        interaction,
        times=interaction.times[rows] - interaction.times[first],
        person_a=interaction.person_a[rows],
        person_b=interaction.person_b[rows],
    )


def check_common_skeleton(interactions: Sequence[Interaction]) -> None:
    """Check that interactions share one skeleton.

    Raises
    ------
    ValueError
        If there are none, or their skeletons differ.
    """
    skeletons = {interaction.skeleton for interaction in interactions}
    if len(skeletons) != 1:
        names = sorted(skeleton.name for skeleton in skeletons)
        raise ValueError(f"interactions must share one skeleton; got {names or 'no interaction'}")


def _sample_pair(interaction: Interaction, n_points: int) -> tuple[Motion, Motion]:
    frame = body_frame(interaction.person_a, interaction.skeleton)
    partner, reaction = (
        Spline(interaction.times, frame.to_local(motion).reshape(len(motion), -1))
        .on_grid(n_points)
        .astype(np.float32)
        for motion in (interaction.person_a, interaction.person_b)
    )
    return partner, reaction


def to_partner_frame(interaction: Interaction) -> Interaction:
    """Move both people into the frame of the partner's (``person_a``'s) first pose."""
    frame = body_frame(interaction.person_a, interaction.skeleton)
    return replace(
        interaction,
        person_a=frame.to_local(interaction.person_a),
        person_b=frame.to_local(interaction.person_b),
    )


def replace_reaction(partner: Interaction, reaction: Interaction) -> Interaction:
    """Pair a partner with the reaction to another one, each in the frame of its partner.

    The reaction keeps its place relative to its own partner and is resampled to the duration of the
    new one. So reactions are permuted among partners.

    Parameters
    ----------
    partner : interaction whose ``person_a`` stays
    reaction : interaction whose ``person_b`` is taken
    """
    out_times = np.linspace(0, 1, len(partner.times))
    times = (reaction.times - reaction.times[0]) / reaction.duration
    motion = CubicSpline(times, reaction.person_b)(out_times).astype(np.float32)
    return replace(partner, person_b=motion)


def mirror_interaction(interaction: Interaction) -> Interaction:
    """Reflect both people in the plane x = 0 and exchange their left and right joints.

    A mirror image is as natural as the interaction.
    """
    return replace(
        interaction,
        person_a=_mirror_motion(interaction.person_a, interaction.skeleton),
        person_b=_mirror_motion(interaction.person_b, interaction.skeleton),
    )


def _mirror_motion(motion: Motion, skeleton: Skeleton) -> Motion:
    order = np.arange(motion.shape[1])
    for left, right in skeleton.left_right:
        order[left], order[right] = right, left
    return np.ascontiguousarray(motion[:, order] * np.array([-1, 1, 1], dtype=np.float32))


MIRROR_X = (-1.0, 1.0, 1.0)  # factors of x, y, z; in the partner's frame left is +x


class RandomAugmentation:
    """Transform a batch at random: both people, but frame rate and joints of the partner alone.

    Parameters
    ----------
    settings : AugmentationSettings
    skeleton : Skeleton
    n_points : grid of the functions
    """

    def __init__(self, settings: AugmentationSettings, skeleton: Skeleton, n_points: int) -> None:
        self.settings, self.root = settings, skeleton.root
        mirrored = dict(skeleton.left_right) | {right: left for left, right in skeleton.left_right}
        self.mirrored_joints = torch.tensor(
            [mirrored.get(i, i) for i in range(len(skeleton.joints))]
        )
        min_frames = max(4, round(settings.min_rate * n_points))
        self.frame_rates = [frame_rate_matrix(n_points, n) for n in range(min_frames, n_points)]

    def __call__(self, pairs: MotionPairs, random: torch.Generator) -> MotionPairs:
        """Sample a transform and a tempo for each interaction, and a frame rate for the batch."""
        partner, reaction = self.people(pairs.partner, pairs.reaction, random)
        if self.frame_rates:
            rate = int(torch.randint(len(self.frame_rates) + 1, (), generator=random))
            if rate < len(self.frame_rates):
                partner = self.frame_rates[rate].to(partner.device) @ partner
        tempo = self.settings.tempo_spread * torch.randn(len(pairs), generator=random)
        log_duration = pairs.log_duration + tempo.to(partner.device)
        return replace(pairs, partner=partner, reaction=reaction, log_duration=log_duration)

    def people(
        self, partner: Tensor, reaction: Tensor, random: torch.Generator
    ) -> tuple[Tensor, Tensor]:
        """Transform both people alike, and move the partner's joints.

        Parameters
        ----------
        partner, reaction : (B, T, 3 J) metres, of any T
        random : CPU generator
        """
        n = len(partner)
        transforms = random_transforms(n, self.settings, random).to(partner.device)
        mirror = torch.rand(n, generator=random) < self.settings.mirror_probability
        there, back = (
            self._transform(motion, mirror.to(motion.device), transforms)
            for motion in (partner, reaction)
        )
        errors = random_joint_errors(partner.shape, self.settings, self.root, random)
        return there + errors.to(there.device), back

    def _transform(self, motion: Tensor, mirror: Tensor, transforms: Tensor) -> Tensor:
        joints = motion.view(*motion.shape[:-1], -1, 3)
        image = joints[:, :, self.mirrored_joints] * joints.new_tensor(MIRROR_X)
        joints = torch.where(mirror[:, None, None, None], image, joints)
        return (joints @ transforms[:, None]).flatten(2)


def random_transforms(n: int, settings: AugmentationSettings, random: torch.Generator) -> Tensor:
    """Sample ``(n, 3, 3)``: scaled rotations about the vertical axis, for row vectors."""
    angle = settings.rotation_spread * torch.randn(n, generator=random)
    size = (settings.size_spread * torch.randn(n, generator=random)).exp()
    cos, sin, zero, one = angle.cos(), angle.sin(), torch.zeros(n), torch.ones(n)
    rows = [[cos, zero, -sin], [zero, one, zero], [sin, zero, cos]]
    return size[:, None, None] * torch.stack([torch.stack(row, dim=-1) for row in rows], dim=-2)


def random_joint_errors(
    shape: Sequence[int], settings: AugmentationSettings, root: int, random: torch.Generator
) -> Tensor:
    """Sample ``(n, T, 3 J)`` metres by which a partner's joints are elsewhere in another capture.

    Skeletons of other systems put a joint at another place of the body: an offset that lasts, in
    fixed axes, of all joints but the root, where the partner's frame is. Sensors add noise to all
    joints: its level is uniform from 0 to twice ``joint_noise``.
    """
    n, n_times, channels = shape
    offset = settings.joint_offset * torch.randn(n, 1, channels, generator=random)
    offset[..., 3 * root : 3 * root + 3] = 0
    level = 2 * settings.joint_noise * torch.rand(n, 1, 1, generator=random)
    return offset + level * torch.randn(n, n_times, channels, generator=random)


def frame_rate_matrix(n_points: int, n_frames: int) -> Tensor:
    """Build the ``(N, N)`` matrix that resamples a function at fewer frames and back by splines."""
    grid, frames = np.linspace(0, 1, n_points), np.linspace(0, 1, n_frames)
    resampled = CubicSpline(grid, np.eye(n_points))(frames)
    return torch.tensor(CubicSpline(frames, resampled)(grid), dtype=torch.float32)
