"""Clips made small enough to travel inside a page: 16-bit steps from an origin, base64."""

import base64
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.interaction import Interaction, Motion
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.figures.body import body_of

_STEPS = np.iinfo(np.int16).max
_SOLE = 0.04  # metres that the ground lies below the lowest joint
_HAIR = 0.12  # metres that a head rises above its joint
_SAME_PLACE = 0.05  # metres between first roots from which two scenes are not of one world
_FOLLOWED_S = 0.5  # seconds to either side over which a camera that follows averages


@dataclass(frozen=True)
class Scene:
    """One clip to be shown: one or two people.

    Parameters
    ----------
    label : what is shown, such as a clip's name; shown as it is, never run
    skeleton : of everybody
    times : (T,) float64, seconds, rising
    people : one or two of (T, J, 3) float32, metres, y up, finite

    Raises
    ------
    ValueError
        If there are not one or two people, or a motion has another shape.
    """

    label: str
    skeleton: Skeleton
    times: NDArray[np.float64]
    people: tuple[Motion, ...]

    def __post_init__(self) -> None:
        wanted = (len(self.times), len(self.skeleton.joints), 3)
        shapes = [motion.shape for motion in self.people]
        if len(shapes) not in (1, 2) or any(shape != wanted for shape in shapes):
            raise ValueError(f"scene {self.label!r}: wanted one or two of {wanted}; got {shapes}")

    @staticmethod
    def of(label: str, interaction: Interaction) -> "Scene":
        """Show both people of an interaction."""
        people = (interaction.person_a, interaction.person_b)
        return Scene(label, interaction.skeleton, interaction.times, people)


def pack(motion: Motion, origin: NDArray[np.float64], step: float) -> str:
    """Write a motion as whole steps from ``origin``: half a step off at worst, along each axis.

    Returns
    -------
    Base64 of little-endian int16, in the order of the array.
    """
    return base64.b64encode(np.rint((motion - origin) / step).astype("<i2").tobytes()).decode()


def unpack(text: str, origin: NDArray[np.float64], step: float) -> NDArray[np.float64]:
    """Read what ``pack`` wrote, as the page does: ``(N, 3)`` metres."""
    steps = np.frombuffer(base64.b64decode(text), "<i2").reshape(-1, 3)
    places: NDArray[np.float64] = origin + steps * step
    return places


def packed_scenes(scenes: Sequence[Scene], *, contact: float) -> list[dict[str, Any]]:
    """Turn scenes into what the player reads, ready for JSON.

    Scenes of one world, as a capture and reactions in it, share ground and camera.

    Parameters
    ----------
    contact : metres between joints of two people that touch
    """
    views: list[dict[str, Any]] = []
    for at, scene in enumerate(scenes):
        known = [k for k in range(at) if _one_world(scenes[k], scene)]
        world = [other for other in scenes if _one_world(other, scene)]
        views.append(views[known[0]] if known else _view(world))
    return [
        _packed(scene, contact) | {"view": view} for scene, view in zip(scenes, views, strict=True)
    ]


def _packed(scene: Scene, contact: float) -> dict[str, Any]:
    everyone = _everyone(scene)
    low, high = everyone.min(axis=(0, 1)), everyone.max(axis=(0, 1))
    origin = (low + high) / 2
    step = max(float((high - low).max()) / 2 / _STEPS, 1e-6)
    return {
        "label": scene.label,
        "joints": scene.skeleton.joints,
        "parents": scene.skeleton.parents,
        "root": scene.skeleton.root,
        "body": asdict(body_of(scene.skeleton)),
        "contact": contact,
        "times": base64.b64encode((scene.times - scene.times[0]).astype("<f8").tobytes()).decode(),
        "origin": origin.tolist(),
        "step": step,
        "motions": [pack(motion, origin, step) for motion in scene.people],
    }


def _everyone(scene: Scene) -> NDArray[np.float64]:
    """``(T, P J, 3)`` metres: the joints of all."""
    return np.concatenate(scene.people, axis=1).astype(np.float64)


def _view(world: Sequence[Scene]) -> dict[str, Any]:
    """Say where the ground is, how far people get, and from where they are seen side by side.

    The ground is the median over frames of the lowest joint: a depth camera that leans, or
    loses a foot, leaves single frames far below the floor.
    """
    everyone = [_everyone(scene) for scene in world]
    flat = [people[..., [0, 2]] for people in everyone]
    low, high = np.percentile(np.concatenate([f.reshape(-1, 2) for f in flat]), [1, 99], axis=0)
    centre = (low + high) / 2
    near = [f - _followed(scene)[:, None] for f, scene in zip(flat, world, strict=True)]
    return {
        "centre": centre.round(4).tolist(),
        "ground": round(float(np.median(everyone[0][..., 1].min(axis=1))) - _SOLE, 4),
        "top": round(
            max(float(np.percentile(p[..., 1].max(axis=1), 95)) for p in everyone) + 0.12, 4
        ),
        "reach": max(_reach(f - centre) for f in flat),
        "near": max(map(_reach, near)),
        "yaw": _yaw(world[0]),
    }


def _top(everyone: NDArray[np.float64]) -> float:
    return float(np.percentile(everyone[..., 1].max(axis=1), 95))


def _reach(away: NDArray[np.float64]) -> float:
    return round(float(np.percentile(np.linalg.norm(away, axis=-1), 99)), 4)


def _followed(scene: Scene) -> NDArray[np.float64]:
    """``(T, 2)`` metres on the ground: the mean of all roots, averaged over a second."""
    roots = np.stack([motion[:, scene.skeleton.root] for motion in scene.people])[..., [0, 2]]
    sums = np.concatenate([np.zeros((1, 2)), roots.mean(axis=0, dtype=np.float64).cumsum(axis=0)])
    first = np.searchsorted(scene.times, scene.times - _FOLLOWED_S)
    last = np.searchsorted(scene.times, scene.times + _FOLLOWED_S, side="right")
    path: NDArray[np.float64] = (sums[last] - sums[first]) / (last - first)[:, None]
    return path


def _yaw(scene: Scene) -> float:
    """Radians about +y at which the camera stands: two people side by side, the first left."""
    if len(scene.people) < 2:
        return 0.0
    apart = (scene.people[1] - scene.people[0]).mean(axis=(0, 1))
    return round(float(np.arctan2(-apart[2], apart[0])), 4)


def _one_world(first: Scene, second: Scene) -> bool:
    places = [
        [motion[0, scene.skeleton.root] for motion in scene.people] for scene in (first, second)
    ]
    return any(np.linalg.norm(p - q) < _SAME_PLACE for p in places[0] for q in places[1])
