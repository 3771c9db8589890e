"""Training data: variations as tensors, in the canonical frame of their source, at keyframes.

Displacements between a source and its variations are smooth in time, so the networks see only
keyframes; ``interpolate_keyframes`` returns to all frames by a cubic spline.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from torch import Tensor

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.data.transforms import Frame, body_frame

# Quantile of a source's joint heights that is the height of the ground; lower ones are noise.
GROUND_QUANTILE = 0.005


@dataclass(frozen=True)
class Example:
    """A source and one of its variations."""

    source: str  # its name; examples of one source share the template
    template: Interaction  # the source itself, both people at scale 1
    scales: NDArray[np.float64]  # (2, E), of each of ``skeleton.bones``, of person a and person b
    variation: Interaction  # on the scaled skeletons

    def __post_init__(self) -> None:
        shape = (2, len(self.template.skeleton.bones))
        if self.scales.shape != shape or not (self.scales > 0).all():
            raise ValueError(
                f"source {self.source}: scales must be {shape} and positive; "
                f"got {self.scales.shape}, smallest {self.scales.min(initial=np.inf):g}"
            )
        if self.variation.person_a.shape != self.template.person_a.shape:
            raise ValueError(
                f"source {self.source}: variation must be {self.template.person_a.shape}; "
                f"got {self.variation.person_a.shape}"
            )


@dataclass(frozen=True)
class ExampleBatch:
    """Examples of equal length; characters in the order in which they are generated."""

    template: Tensor  # (B, T, 2, J, 3), metres
    variation: Tensor  # (B, T, 2, J, 3), metres
    scales: Tensor  # (B, 2, J), of the bone into each joint; 1 at the root

    def select(self, rows: Tensor) -> "ExampleBatch":
        """Select the examples where rows (B,) bool is set."""
        return ExampleBatch(self.template[rows], self.variation[rows], self.scales[rows])

    def swapped(self, rows: Tensor) -> "ExampleBatch":
        """Swap the characters where rows (B,) bool is set."""
        return ExampleBatch(
            torch.where(rows[:, None, None, None, None], self.template.flip(2), self.template),
            torch.where(rows[:, None, None, None, None], self.variation.flip(2), self.variation),
            torch.where(rows[:, None, None], self.scales.flip(1), self.scales),
        )

    def mirrored(self, rows: Tensor, skeleton: Skeleton) -> "ExampleBatch":
        """Mirror left and right where rows (B,) bool is set."""
        joints = torch.arange(self.scales.shape[-1])
        for left, right in skeleton.left_right:
            joints[left], joints[right] = right, left
        flip = self.template.new_tensor([-1.0, 1.0, 1.0])
        chosen = rows[:, None, None, None, None]
        return ExampleBatch(
            torch.where(chosen, self.template[..., joints, :] * flip, self.template),
            torch.where(chosen, self.variation[..., joints, :] * flip, self.variation),
            torch.where(rows[:, None, None], self.scales[..., joints], self.scales),
        )

    def rotated(self, angles: Tensor) -> "ExampleBatch":
        """Rotate each example about the vertical by angles (B,), radians."""
        rotations = _rotations_about_y(angles)[:, None, None]
        return replace(
            self, template=self.template @ rotations, variation=self.variation @ rotations
        )


@dataclass(frozen=True)
class ExampleDataset:
    """Examples in the canonical frames of their sources, at their own lengths and rates."""

    templates: list[Tensor]  # of each source, (T_i, 2, J, 3), metres
    variations: list[Tensor]  # of each example, of the shape of its source's template
    sources: Tensor  # (N,), index of each example's template
    scales: Tensor  # (N, 2, J)

    def __len__(self) -> int:
        """Count the examples."""
        return len(self.variations)

    def full_length_batches(self, stride: int, max_size: int) -> Iterator[ExampleBatch]:
        """Yield all examples at their keyframes, in batches of one source."""
        for source, template in enumerate(self.templates):
            frames = list(keyframe_indices(len(template), stride))
            examples = torch.nonzero(self.sources == source)[:, 0]
            for rows in examples.chunk(-(-len(examples) // max_size)):
                variation = torch.stack([self.variations[row][frames] for row in rows.tolist()])
                yield ExampleBatch(
                    template[frames].expand_as(variation), variation, self.scales[rows]
                )

    def random_windows(
        self, rows: Tensor, stride: int, window_frames: int, random: torch.Generator
    ) -> ExampleBatch:
        """Sample a window of keyframes, ``stride`` frames apart, of each example.

        Examples shorter than a window repeat their last frame.
        """
        templates, variations = [], []
        for row in rows.tolist():
            template, variation = self.templates[int(self.sources[row])], self.variations[row]
            n_starts = max(1, len(template) - (window_frames - 1) * stride)
            start = int(torch.randint(n_starts, (), generator=random))
            frames = (start + stride * torch.arange(window_frames)).clamp(max=len(template) - 1)
            templates.append(template[frames])
            variations.append(variation[frames])
        return ExampleBatch(torch.stack(templates), torch.stack(variations), self.scales[rows])

    def to(self, device: str) -> "ExampleDataset":
        """Copy the tensors to a device."""
        return ExampleDataset(
            [template.to(device) for template in self.templates],
            [variation.to(device) for variation in self.variations],
            self.sources,
            self.scales.to(device),
        )


def encode_examples(examples: Sequence[Example]) -> ExampleDataset:
    """Convert examples to tensors; the person whose skeleton changes is the first character.

    The paper's model takes the scales of the first character only, so these must be the scales that
    differ from 1 (supplement, figure 6: the skeleton of one character is changed).
    """
    templates: dict[tuple[str, bool], Tensor] = {}
    variations, sources, scales = [], [], []
    for example in examples:
        b_first = is_b_first(example.scales)
        key = (example.source, b_first)
        frame = canonical_frame(example.template)
        if key not in templates:
            templates[key] = stack_characters(example.template, frame, b_first=b_first)
        variations.append(stack_characters(example.variation, frame, b_first=b_first))
        sources.append(list(templates).index(key))
        joint_scales = scales_by_joint(example.scales, example.template.skeleton)
        scales.append(joint_scales.flip(0) if b_first else joint_scales)
    return ExampleDataset(
        list(templates.values()), variations, torch.tensor(sources), torch.stack(scales)
    )


def is_b_first(scales: NDArray[np.float64]) -> bool:
    """Check whether person b is the first character: unless only a's scales differ from 1."""
    changed = (scales != 1).any(axis=1)
    return bool(changed[1] or not changed[0])


def canonical_frame(interaction: Interaction) -> Frame:
    """Compute the frame midway between both people's first positions, facing as person a."""
    root = interaction.skeleton.root
    frame = body_frame(interaction.person_a, interaction.skeleton)
    both = np.stack([interaction.person_a, interaction.person_b]).astype(np.float64)
    origin = both[:, 0, root].mean(axis=0)
    origin[1] = np.quantile(both[..., 1], GROUND_QUANTILE)
    return Frame(origin, frame.yaw)


def stack_characters(interaction: Interaction, frame: Frame, *, b_first: bool) -> Tensor:
    """Stack both people's motions in a frame: ``(T, 2, J, 3)`` float32, metres."""
    people = [interaction.person_a, interaction.person_b]
    motions = [frame.to_local(motion) for motion in (people[::-1] if b_first else people)]
    return torch.from_numpy(np.stack(motions, axis=1))


def scales_by_joint(scales: NDArray[np.float64], skeleton: Skeleton) -> Tensor:
    """Convert scales of bones ``(..., E)`` to joints ``(..., J)`` float32, 1 at the root."""
    result = np.ones((*scales.shape[:-1], len(skeleton.joints)))
    result[..., skeleton.bones[:, 1]] = scales
    return torch.tensor(result, dtype=torch.float32)


@lru_cache(maxsize=64)
def keyframe_indices(n_frames: int, stride: int) -> tuple[int, ...]:
    """Choose frames about ``stride`` apart, including the first and the last."""
    n_keys = -(-(n_frames - 1) // stride) + 1
    return tuple(np.linspace(0, n_frames - 1, n_keys).round().astype(int).tolist())


def interpolate_keyframes(values: Tensor, n_frames: int, stride: int) -> Tensor:
    """Interpolate keyframes ``(B, K, J, C)`` to all frames ``(B, T, J, C)`` by a cubic spline."""
    keyframes = keyframe_indices(n_frames, stride)
    spline = CubicSpline(keyframes, values.cpu().numpy(), axis=1)
    return torch.from_numpy(spline(np.arange(n_frames)).astype(np.float32)).to(values.device)


def _rotations_about_y(angles: Tensor) -> Tensor:
    cos, sin, zero = angles.cos(), angles.sin(), torch.zeros_like(angles)
    rows = [cos, zero, sin, zero, zero + 1, zero, -sin, zero, cos]
    return torch.stack(rows, dim=-1).view(-1, 3, 3)
