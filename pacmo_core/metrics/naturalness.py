"""How natural retargeted motions look: the solver's own measurements, of any motions on any bodies.

The same are shown of the solver's variations, so that the two can be compared: what changes that
the other body does not explain (``interaction_mesh.report``).
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.interaction import Interaction
from pacmo_core.interaction_mesh import Scene, Settings
from pacmo_core.interaction_mesh.mesh import ground_supports
from pacmo_core.interaction_mesh.report import measure_motions

# Measurements of a variation that are compared.
MEASURES = (
    "knee_change",
    "elbow_change",
    "hip_change",
    "shoulder_change",
    "spine_change",
    "below_floor",
    "added_foot_skate",
    "contacts_kept",
    "near_distance_error",
    "peak_acceleration_ratio",
)


def naturalness(
    source: Interaction,
    settings: Settings,
    scales: NDArray[np.float64],
    motions: Sequence[Interaction],
) -> dict[str, float]:
    """Measure motions of a source on other bodies; return the means over the bodies.

    Parameters
    ----------
    settings : of the solver, which define contact and support
    scales : (V, 2, E), of the bones of person a and person b
    motions : V, of the source's length

    Returns
    -------
    by name of ``interaction_mesh.Report``, in its units
    """
    scene = Scene((source.person_a, source.person_b), (source.skeleton,) * 2, source.fps)
    points = np.stack(
        [np.concatenate([motion.person_a, motion.person_b], axis=1) for motion in motions], axis=-1
    ).astype(np.float64)
    measured = measure_motions(
        scene,
        settings,
        ground_supports(scene, settings.support),
        scales.reshape(len(scales), -1),
        points,
    )
    return {name: float(np.mean(measured[name])) for name in MEASURES}
