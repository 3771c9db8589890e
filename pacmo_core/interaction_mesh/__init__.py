"""InteractionMesh: a two-person motion on other bodies, its spatial relations kept."""

from pacmo_core.interaction_mesh.report import Report
from pacmo_core.interaction_mesh.scene import Scene
from pacmo_core.interaction_mesh.settings import Limits, Rung, Settings, Support, Weights
from pacmo_core.interaction_mesh.source import BATCH, Source, prepare
from pacmo_core.interaction_mesh.vary import Variations, vary, vary_in_batches

__all__ = [
    "BATCH",
    "Limits",
    "Report",
    "Rung",
    "Scene",
    "Settings",
    "Source",
    "Support",
    "Variations",
    "Weights",
    "prepare",
    "vary",
    "vary_in_batches",
]
