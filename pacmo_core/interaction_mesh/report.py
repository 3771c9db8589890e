"""How good a variation is."""

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from pacmo_core.interaction_mesh.distances import distances_of
from pacmo_core.interaction_mesh.hinges import flips
from pacmo_core.interaction_mesh.scene import Array, Scene
from pacmo_core.interaction_mesh.settings import Limits, Settings
from pacmo_core.interaction_mesh.supports import steps_of

# Frames to either side among which a frame's acceleration is judged.
AROUND = 10


@dataclass(frozen=True, kw_only=True)
class Report:
    """Figures of one variation, before the scene is scaled as a whole.

    Parameters
    ----------
    near_error, far_error : metres, by how much distances between the bodies differ from the
        source's, in pairs of joints near in it and in all others
    near_error_naive : the same of naive scaling
    contacts_kept : share of touching pairs and frames
    added_slide : metres a second that standing joints move more than in the source
    penetration : metres that joints come closer than in the source, within the clearance, at worst
    seam_ratio : the largest mean acceleration of a frame over the median of those around it, or
        over the source's own such ratio where that is above 1
    flip_share : of frames, those where an elbow or knee bends to the other side
    rung : which try it is, from 0
    raw_residual : share of its length by which a bone missed it before it was set, at worst
    last_step : by how much the solver's last iteration still moved bones, root mean square, as a
        share of what the body is asked to change (``ladder.asked_of``)
    iterations : of the try
    energy : the terms
    """

    near_error: float
    far_error: float
    near_error_naive: float
    contacts_kept: float
    added_slide: float
    penetration: float
    seam_ratio: float
    flip_share: float
    rung: int
    raw_residual: float
    last_step: float
    iterations: int
    energy: dict[str, float]

    def badness(self, limits: Limits) -> float:
        """Give the worst of its figures as a share of their limits: good up to 1."""
        return max(
            self.raw_residual / limits.residual,
            self.penetration / limits.penetration,
            self.seam_ratio / limits.seam,
        )

    def astray(self, limits: Limits) -> bool:
        """Say whether the solver went where more iterations will not help."""
        return self.raw_residual > limits.residual or self.seam_ratio > limits.seam


def figures_of(
    scene: Scene, settings: Settings, standing: NDArray[np.bool_], points: Array
) -> dict[str, Array]:
    """Measure motions (T, N, 3, V), metres, by ``Report``'s names, (V,) each."""
    ours = distances_of(scene, settings, points)
    own_slide = _slide(scene.points[..., None], standing, scene.fps)
    return {
        "near_error": ours.near,
        "far_error": ours.far,
        "contacts_kept": ours.kept,
        "added_slide": _slide(points, standing, scene.fps) - own_slide,
        "penetration": ours.penetration.clip(min=0),
        "seam_ratio": _seam_ratio(scene, points),
        "flip_share": flips(scene, points),
    }


def spikes(points: Array) -> Array:
    """``(T - 2, V)``: mean acceleration of the joints over the median of the frames around.

    Parameters
    ----------
    points : (T, N, 3, V), T >= 3
    """
    bends = points[2:] - points[1:-1]
    bends -= points[1:-1]
    bends += points[:-2]
    accelerations = np.sqrt(np.einsum("tncv,tncv->tnv", bends, bends)).mean(axis=1)
    padded = np.pad(accelerations, ((AROUND, AROUND), (0, 0)), mode="reflect")
    medians = np.median(sliding_window_view(padded, 2 * AROUND + 1, axis=0), axis=-1)
    ratios: Array = accelerations / np.maximum(medians, np.finfo(np.float32).tiny)
    return ratios


def _seam_ratio(scene: Scene, points: Array) -> Array:
    if len(scene.points) < AROUND + 3:
        return np.ones(points.shape[-1])
    own = np.maximum(1, spikes(scene.points[..., None]))
    ratio: Array = (spikes(points) / own).max(axis=0)
    return ratio


def _slide(points: Array, standing: NDArray[np.bool_], fps: float) -> Array:
    """``(V,)`` metres a second: mean horizontal speed of what stands."""
    stands = steps_of(standing)
    if not stands.any():
        return np.zeros(points.shape[-1])
    frame, joint = np.nonzero(stands)
    steps = points[frame + 1, joint, ::2] - points[frame, joint, ::2]
    speeds: Array = np.linalg.norm(steps, axis=1).mean(axis=0) * fps
    return speeds
