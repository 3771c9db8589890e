"""InteractionMesh: retargets a two-person motion to other bodies and preserves the interaction.

Ho, Komura and Tai (2010), *Spatial relationship preserving character motion adaptation*: the motion
with the target bone lengths minimises the deformation of a mesh that connects both bodies.
``prepare`` builds and factorises the energy of a source scene once; ``retarget`` solves for any
number of target bodies by ADMM.
"""

from pacmo_core.interaction_mesh.attempt import MAX_BATCH
from pacmo_core.interaction_mesh.report import Report
from pacmo_core.interaction_mesh.retargeting import (
    PreparedSource,
    Variations,
    prepare,
    retarget,
    retarget_in_batches,
)
from pacmo_core.interaction_mesh.scene import Scene
from pacmo_core.interaction_mesh.settings import (
    Attempt,
    AttemptLimits,
    Posture,
    Settings,
    Support,
    Weights,
)

__all__ = [
    "MAX_BATCH",
    "Attempt",
    "AttemptLimits",
    "Posture",
    "PreparedSource",
    "Report",
    "Scene",
    "Settings",
    "Support",
    "Variations",
    "Weights",
    "prepare",
    "retarget",
    "retarget_in_batches",
]
