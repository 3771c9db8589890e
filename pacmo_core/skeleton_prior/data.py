"""Variations as tensors: every few frames of a window, in the source's canonical frame."""

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

# Share of a source's joint heights below the ground: noise, not ground.
GROUND_QUANTILE = 0.005


@dataclass(frozen=True)
class Example:
    """A source, other bodies, and the source on them.

    Parameters
    ----------
    source : its name; examples of one name have one template
    template : the source itself, both bodies at scale 1
    scales : (2, E) float64, of each of ``skeleton.bones``: person a's, person b's
    varied : the interaction on those bodies
    """

    source: str
    template: Interaction
    scales: NDArray[np.float64]
    varied: Interaction

    def __post_init__(self) -> None:
        wanted = (2, len(self.template.skeleton.bones))
        if self.scales.shape != wanted or not (self.scales > 0).all():
            raise ValueError(f"scales must be {wanted} and positive; got {self.scales.shape}")
        if self.varied.person_a.shape != self.template.person_a.shape:
            raise ValueError(
                f"source {self.source}: wanted a variation {self.template.person_a.shape}; "
                f"got {self.varied.person_a.shape}"
            )


@dataclass(frozen=True)
class ExampleBatch:
    """Rows of one length; the first of the two characters is generated first.

    Parameters
    ----------
    template : (B, T, 2, J, 3), metres: sources
    varied : (B, T, 2, J, 3), metres: the same on other bodies
    scales : (B, 2, J), of the bone into each joint; the root's is 1
    """

    template: Tensor
    varied: Tensor
    scales: Tensor

    def swapped(self, rows: Tensor) -> "ExampleBatch":
        """Exchange the roles in the rows that are set, (B,) bool."""
        return ExampleBatch(
            torch.where(rows[:, None, None, None, None], self.template.flip(2), self.template),
            torch.where(rows[:, None, None, None, None], self.varied.flip(2), self.varied),
            torch.where(rows[:, None, None], self.scales.flip(1), self.scales),
        )

    def turned(self, angles: Tensor) -> "ExampleBatch":
        """Turn each row about the vertical, (B,) radians."""
        turns = _rotations_about_y(angles)[:, None, None]
        return replace(self, template=self.template @ turns, varied=self.varied @ turns)


@dataclass(frozen=True)
class ExampleDataset:
    """Examples in the canonical frames of their sources, at their own lengths and rates.

    Parameters
    ----------
    templates : of each source (T_i, 2, J, 3)
    varied : of each example, the same shape as its source's
    sources : (N,) which template an example varies
    scales : (N, 2, J)
    """

    templates: list[Tensor]
    varied: list[Tensor]
    sources: Tensor
    scales: Tensor

    def __len__(self) -> int:
        """Count the examples."""
        return len(self.varied)

    def wholes(self, stride: int, most: int) -> Iterator[ExampleBatch]:
        """Yield the keyframes of all examples, a source's in batches of so many at most."""
        for source, template in enumerate(self.templates):
            at = list(keyframe_indices(len(template), stride))
            alike = torch.nonzero(self.sources == source)[:, 0]
            for rows in alike.chunk(-(-len(alike) // most)):
                varied = torch.stack([self.varied[row][at] for row in rows.tolist()])
                yield ExampleBatch(template[at].expand_as(varied), varied, self.scales[rows])

    def windows(
        self, rows: Tensor, stride: int, window: int, random: torch.Generator
    ) -> ExampleBatch:
        """Take of each row ``window`` frames, ``stride`` apart, from anywhere in it.

        Shorter sources hold their last frame.
        """
        found = []
        for row in rows.tolist():
            template, varied = self.templates[int(self.sources[row])], self.varied[row]
            spare = max(1, len(template) - (window - 1) * stride)
            start = int(torch.randint(spare, (), generator=random))
            at = (start + stride * torch.arange(window)).clamp(max=len(template) - 1)
            found.append((template[at], varied[at]))
        return ExampleBatch(
            torch.stack([template for template, _ in found]),
            torch.stack([varied for _, varied in found]),
            self.scales[rows],
        )

    def to(self, device: str) -> "ExampleDataset":
        """Move the tensors."""
        return ExampleDataset(
            [template.to(device) for template in self.templates],
            [varied.to(device) for varied in self.varied],
            self.sources,
            self.scales.to(device),
        )


def encode_examples(examples: Sequence[Example]) -> ExampleDataset:
    """Bring examples into tensors; the changed body comes first.

    Roles: of an example in which one body alone changes, that one is the first. So the form that
    knows one body's scale knows the one that matters (supplement, figure 6: the skeleton of one
    character is changed).
    """
    templates: dict[tuple[str, bool], Tensor] = {}
    varied, sources, scales = [], [], []
    for example in examples:
        b_first = is_b_first(example.scales)
        key = (example.source, b_first)
        frame = canonical_frame(example.template)
        if key not in templates:
            templates[key] = stack_characters(example.template, frame, b_first=b_first)
        varied.append(stack_characters(example.varied, frame, b_first=b_first))
        sources.append(list(templates).index(key))
        own = scales_by_joint(example.scales, example.template.skeleton)
        scales.append(own.flip(0) if b_first else own)
    return ExampleDataset(
        list(templates.values()), varied, torch.tensor(sources), torch.stack(scales)
    )


def is_b_first(scales: NDArray[np.float64]) -> bool:
    """Say whether person b is generated first: unless a alone changes."""
    changed = (scales != 1).any(axis=1)
    return bool(changed[1] or not changed[0])


def canonical_frame(interaction: Interaction) -> Frame:
    """Find the frame between both people's first places, on the ground, facing as person a."""
    root = interaction.skeleton.root
    frame = body_frame(interaction.person_a, interaction.skeleton)
    both = np.stack([interaction.person_a, interaction.person_b]).astype(np.float64)
    origin = both[:, 0, root].mean(axis=0)
    origin[1] = np.quantile(both[..., 1], GROUND_QUANTILE)
    return Frame(origin, frame.yaw)


def stack_characters(interaction: Interaction, frame: Frame, *, b_first: bool) -> Tensor:
    """``(T, 2, J, 3)`` float32 in a frame."""
    people = [interaction.person_a, interaction.person_b]
    motions = [frame.to_local(motion) for motion in (people[::-1] if b_first else people)]
    return torch.from_numpy(np.stack(motions, axis=1))


def scales_by_joint(scales: NDArray[np.float64], skeleton: Skeleton) -> Tensor:
    """``(..., E)`` of bones to ``(..., J)`` float32 of joints; the root's is 1."""
    own = np.ones((*scales.shape[:-1], len(skeleton.joints)))
    own[..., skeleton.bones[:, 1]] = scales
    return torch.tensor(own, dtype=torch.float32)


def _rotations_about_y(angles: Tensor) -> Tensor:
    cos, sin, zero = angles.cos(), angles.sin(), torch.zeros_like(angles)
    rows = [cos, zero, sin, zero, zero + 1, zero, -sin, zero, cos]
    return torch.stack(rows, dim=-1).view(-1, 3, 3)


# FROM """The few frames that networks see, and the way back to all of them: the change is smooth."""
@lru_cache(maxsize=64)
def keyframe_indices(n_frames: int, stride: int) -> tuple[int, ...]:
    """Choose frames about ``stride`` apart, the first and the last among them."""
    n_keys = -(-(n_frames - 1) // stride) + 1
    return tuple(np.linspace(0, n_frames - 1, n_keys).round().astype(int).tolist())


def interpolate_keyframes(field: Tensor, n_frames: int, stride: int) -> Tensor:
    """``(B, K, J, C)`` at keyframes to ``(B, T, J, C)``, by the cubic spline through them."""
    spline = CubicSpline(keyframe_indices(n_frames, stride), field.cpu().numpy(), axis=1)
    return torch.from_numpy(spline(np.arange(n_frames)).astype(np.float32)).to(field.device)
