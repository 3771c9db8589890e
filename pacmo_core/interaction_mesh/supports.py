"""Which joints stand on the ground, and when: feet, and hands and knees where they bear weight."""

import numpy as np
from numpy.typing import NDArray

from pacmo_core.interaction_mesh.scene import Scene
from pacmo_core.interaction_mesh.settings import Support

# Share of a joint's heights below the level that is taken for its lowest: noise, not level.
BELOW_LEVEL = 0.05


def supports(scene: Scene, support: Support) -> NDArray[np.bool_]:
    """``(T, N)``: whether a joint is low, near the ground, and still."""
    heights = scene.points[..., 1]
    level = np.quantile(heights, BELOW_LEVEL, axis=0)
    low = (heights < level + support.height) & (level < scene.ground + support.reach)
    return low & (_speeds(scene) < support.speed)


def holds(standing: NDArray[np.bool_], fps: float, fade: float) -> NDArray[np.float64]:
    """``(T, N)``: 1 where a joint stands; before and after that ``exp(-(seconds / fade)^2)``."""
    held = standing.astype(np.float64)
    for shift in range(1, min(len(held), int(3 * fade * fps) + 1)):
        share = np.exp(-((shift / fps / fade) ** 2))
        held[shift:] = np.maximum(held[shift:], share * standing[:-shift])
        held[:-shift] = np.maximum(held[:-shift], share * standing[shift:])
    return held


def steps_of(standing: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """``(T - 1, N)``: whether a joint stands at both ends of a step."""
    return standing[1:] & standing[:-1]


def _speeds(scene: Scene) -> NDArray[np.float64]:
    """``(T, N)`` metres a second; the slower of the steps before and after."""
    paths = np.linalg.norm(np.diff(scene.points, axis=0), axis=-1) * scene.fps
    if not len(paths):
        return np.zeros(scene.points.shape[:2])
    before = np.concatenate([paths[:1], paths])
    after = np.concatenate([paths, paths[-1:]])
    slower: NDArray[np.float64] = np.minimum(before, after)
    return slower
