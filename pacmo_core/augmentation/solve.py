"""Make some variations of one source: what a process is handed, and what it gives back."""

from dataclasses import asdict, dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pacmo_core.augmentation.bodies import Scales
from pacmo_core.augmentation.keys import maker_key
from pacmo_core.augmentation.shape import trunk_change
from pacmo_core.data.interaction import Interaction, Motion
from pacmo_core.interaction_mesh import Report, Scene, Settings, Source, prepare, vary

ENERGY = "energy"


@dataclass(frozen=True)
class Lot:
    """Bodies for one source.

    Parameters
    ----------
    key : of the source: equal keys, equal sources
    maker : of settings and code, which the process that solves must have too
    source : both people
    settings : of the solver
    scales : (V, E), of each bone of person a, then of person b
    names : of the V bodies
    """

    key: str
    maker: str
    source: Interaction
    settings: Settings
    scales: Scales
    names: tuple[str, ...]


@dataclass(frozen=True)
class Made:
    """One variation.

    Parameters
    ----------
    motions : (2, T, J, 3) float32, metres
    figures : the report's, by name
    """

    motions: Motion
    figures: dict[str, float]


@dataclass(frozen=True)
class Outcome:
    """What came of a lot: all its variations by name, or the reason why there are none."""

    key: str
    made: dict[str, Made]
    refused: str = ""


def scene_of(interaction: Interaction) -> Scene:
    """See two people as one scene.

    Raises
    ------
    ValueError
        If a body is flat, or a bone has no length.
    """
    both = (interaction.person_a, interaction.person_b)
    return Scene(both, (interaction.skeleton,) * 2, interaction.fps)


def solve(lot: Lot) -> Outcome:
    """Make a lot; what the solver refuses is an outcome, not an end.

    Raises
    ------
    RuntimeError
        If this process, of a cluster perhaps, runs other code than the one that asks.
    """
    if maker_key(lot.settings) != lot.maker:
        raise RuntimeError("this worker has other code, NumPy or SciPy than who asks: restart it")
    try:
        found = vary(_prepared(Prepared(lot)), lot.scales)
    except ValueError as fault:
        return Outcome(lot.key, {}, " ".join(str(fault).split()))
    made = {}
    for row, name in enumerate(lot.names):
        motions = people_of(found.points[row], lot.source)
        figures = figures_of(found.reports[row])
        made[name] = Made(motions, figures | _shape(lot, motions, lot.scales[row]))
    return Outcome(lot.key, made)


def people_of(points: NDArray[np.float64], source: Interaction) -> Motion:
    """``(2, T, J, 3)`` float32: part the points (T, 2 J, 3) of a scene of equal skeletons."""
    shape = (len(points), 2, len(source.skeleton.joints), 3)
    return np.ascontiguousarray(points.reshape(shape).swapaxes(0, 1), dtype=np.float32)


def figures_of(report: Report) -> dict[str, float]:
    """List a report's figures by name, the energy's terms as ``energy_...``."""
    plain = {name: value for name, value in asdict(report).items() if name != ENERGY}
    terms = {f"{ENERGY}_{name}": value for name, value in report.energy.items()}
    return {name: float(value) for name, value in (plain | terms).items()}


def _shape(lot: Lot, motions: Motion, scales: Scales) -> dict[str, float]:
    """Measure what the report does not: the worse of the two trunks."""
    people = (lot.source.person_a, lot.source.person_b)
    changes = [
        trunk_change(person, motion, lot.source.skeleton, own)
        for person, motion, own in zip(people, motions, np.split(scales, 2), strict=True)
    ]
    return {"trunk_change": max(changes)}


class Prepared:
    """A lot that stands for its source: the last one's factorisation serves the next lot too."""

    def __init__(self, lot: Lot) -> None:
        self.lot = lot

    def __hash__(self) -> int:
        return hash((self.lot.key, self.lot.maker))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Prepared):
            return NotImplemented
        return (other.lot.key, other.lot.maker) == (self.lot.key, self.lot.maker)


@lru_cache(maxsize=1)
def _prepared(of: Prepared) -> Source:
    return prepare(scene_of(of.lot.source), of.lot.settings)
