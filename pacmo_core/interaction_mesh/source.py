"""A source made ready for the bodies that it will get."""

from dataclasses import dataclass, field

import numpy as np

from pacmo_core.interaction_mesh.admm import Solver
from pacmo_core.interaction_mesh.answers import Answers, answers
from pacmo_core.interaction_mesh.energy import Quadratic, quadratic
from pacmo_core.interaction_mesh.factor import factorise, stiffness
from pacmo_core.interaction_mesh.lay_out import solver_of
from pacmo_core.interaction_mesh.products import WIDTH
from pacmo_core.interaction_mesh.rows import bone_rows, guarded_rows
from pacmo_core.interaction_mesh.scene import Array, Scene
from pacmo_core.interaction_mesh.settings import Rung, Settings
from pacmo_core.interaction_mesh.threads import one_thread

# Bodies at once, and the frames of all of them together: what bounds the memory.
BATCH = 48
FRAMES = 40_000


@dataclass(frozen=True)
class Source:
    """A scene with all that does not depend on the bodies it will get.

    Parameters
    ----------
    scene, settings : as given to ``prepare``
    energy : its matrices
    stiffness : (T, E), by which penalties are stated
    answers : to each bone that grows, from which iterations start
    solvers : by penalties, made when first wanted
    """

    scene: Scene
    settings: Settings
    energy: Quadratic
    stiffness: Array
    answers: Answers
    solvers: dict[tuple[float, float], Solver] = field(default_factory=dict)

    @property
    def batch(self) -> int:
        """How many bodies to take at once."""
        most = FRAMES // len(self.scene.points) // WIDTH * WIDTH
        return min(BATCH, max(WIDTH, most))

    def grown(self, scales: Array) -> Array:
        """``(V, E)`` square metres: by how much bones grow, summed over frames."""
        squares = np.square(self.scene.vectors).sum(axis=(0, 2))
        grown: Array = np.square(scales - 1) * squares
        return grown

    def solver(self, rung: Rung) -> Solver:
        """Give the solver of a rung."""
        penalties = (rung.penalty, rung.apart)
        if penalties not in self.solvers:
            scene, settings = self.scene, self.settings
            rows = bone_rows(scene, rung.penalty * self.stiffness)
            if rung.apart:
                rows = guarded_rows(scene, rows, rung.apart, settings.guarded, settings.clearance)
            self.solvers[penalties] = solver_of(
                factorise(self.energy, rows),
                rows,
                n_bones=len(scene.bones),
                relaxation=settings.relaxation,
            )
        return self.solvers[penalties]


def prepare(scene: Scene, settings: Settings) -> Source:
    """Build graph, weights and factorisation of a source."""
    with one_thread():
        energy = quadratic(scene, settings)
        source = Source(scene, settings, energy, stiffness(energy, scene), answers(scene, energy))
        source.solver(settings.rungs[0])
    return source
