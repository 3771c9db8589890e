"""What a variation rests on, as a hash: the same hash, the same bytes.

A variation does not depend on the others that are made with it
(tests/augmentation/test_run.py), so it can be cached under its own hash, and another plan
computes just what is new.
"""

import hashlib
import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pacmo_core.augmentation.bodies import Scales
from pacmo_core.augmentation.segments import segments
from pacmo_core.data.interaction import Interaction, Motion
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.execution import DaskExecutor, ProcessExecutor
from pacmo_core.interaction_mesh import PreparedSource, Report, Scene, Settings, prepare, retarget
from pacmo_core.store.cache import code_hash

# What a variation runs: an edit elsewhere does not cost what is kept.
SOLVER_CODE = (
    *("data/skeleton.py", "interaction_mesh/*.py"),
    *("augmentation/run.py", "augmentation/segments.py"),
)
SOLVER_PACKAGES = ("numpy", "scipy")
HASH_LENGTH = 32  # characters of a hash


def solver_key(settings: Settings) -> str:
    """Hash what makes variations: the solver's settings, the code, the versions it runs on."""
    text = json.dumps([asdict(settings), code_hash(SOLVER_CODE, SOLVER_PACKAGES)], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:HASH_LENGTH]


def source_key(interaction: Interaction) -> str:
    """Hash what is varied: both motions, their rate and their skeleton, whatever its name."""
    skeleton = interaction.skeleton
    facts = [interaction.fps, skeleton.joints, skeleton.parents, skeleton.left_right]
    digest = hashlib.sha256(json.dumps(facts).encode())
    for motion in (interaction.person_a, interaction.person_b):
        digest.update(motion.astype("<f4").tobytes())
    return digest.hexdigest()[:HASH_LENGTH]


def body_key(scales: tuple[Scales, Scales]) -> str:
    """Hash the bodies that are given."""
    digest = hashlib.sha256()
    for own in scales:
        digest.update(own.astype("<f8").tobytes())
    return digest.hexdigest()[:HASH_LENGTH]


# FROM """Whether a body is still one: right lengths may stand at angles that no trunk allows."""
def trunk_deformation(source: Motion, varied: Motion, skeleton: Skeleton, scales: Scales) -> float:
    """Give the share by which two joints of the trunk are nearer or farther than they should be.

    Should be: as if every bone were scaled along its own direction. Of each pair of joints the
    median over time counts, and of all pairs the worst.

    Parameters
    ----------
    source, varied : (T, J, 3) metres, of one person
    scales : (E,)
    """
    joints = _trunk_joints(skeleton)
    if len(joints) < 2:
        return 0.0
    wanted = _pair_distances(
        _scale_along_bones(source.astype(np.float64), skeleton, scales)[:, joints]
    )
    found = _pair_distances(varied.astype(np.float64)[:, joints])
    return float(np.abs(np.median(found / wanted, axis=0) - 1).max())


def _trunk_joints(skeleton: Skeleton) -> list[int]:
    """List the root and the joints at which bones of the trunk end, but for the head's."""
    named = zip(skeleton.bones[:, 1].tolist(), segments(skeleton), strict=True)
    above = {"head", "neck", "upperneck", "lowerneck"}
    return [
        skeleton.root,
        *(joint for joint, s in named if s.part == "trunk" and not above & set(s.name.split("_"))),
    ]


def _scale_along_bones(
    motion: NDArray[np.float64], skeleton: Skeleton, scales: Scales
) -> NDArray[np.float64]:
    """``(T, J, 3)``: each bone longer along its own direction, from the root outwards."""
    scale_of = dict(zip(skeleton.bones[:, 1].tolist(), scales.tolist(), strict=True))
    places = motion.copy()
    for joint in skeleton.order[1:]:
        parent = skeleton.parents[joint]
        bone = motion[:, joint] - motion[:, parent]
        places[:, joint] = places[:, parent] + scale_of[joint] * bone
    return places


def _pair_distances(places: NDArray[np.float64]) -> NDArray[np.float64]:
    """``(T, P)`` metres: of each pair of joints."""
    one, other = np.triu_indices(places.shape[1], k=1)
    distances: NDArray[np.float64] = np.linalg.norm(places[:, one] - places[:, other], axis=-1)
    return np.maximum(distances, np.finfo(np.float32).tiny)


# FROM """Make some variations of one source: what a process is handed, and what it gives back."""
ENERGY = "energy"


@dataclass(frozen=True)
class Batch:
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
class SolvedVariation:
    """One variation.

    Parameters
    ----------
    motions : (2, T, J, 3) float32, metres
    figures : the report's, by name
    """

    motions: Motion
    figures: dict[str, float]


@dataclass(frozen=True)
class BatchResult:
    """What came of a lot: all its variations by name, or the reason why there are none."""

    key: str
    made: dict[str, SolvedVariation]
    refused: str = ""


def scene_from(interaction: Interaction) -> Scene:
    """See two people as one scene.

    Raises
    ------
    ValueError
        If a body is flat, or a bone has no length.
    """
    both = (interaction.person_a, interaction.person_b)
    return Scene(both, (interaction.skeleton,) * 2, interaction.fps)


def solve_batch(lot: Batch) -> BatchResult:
    """Make a lot; what the solver refuses is an outcome, not an end.

    Raises
    ------
    RuntimeError
        If this process, of a cluster perhaps, runs other code than the one that asks.
    """
    if solver_key(lot.settings) != lot.maker:
        raise RuntimeError("this worker has other code, NumPy or SciPy than who asks: restart it")
    try:
        found = retarget(_prepared_source(_SourceKey(lot)), lot.scales)
    except ValueError as fault:
        return BatchResult(lot.key, {}, " ".join(str(fault).split()))
    made = {}
    for row, name in enumerate(lot.names):
        motions = split_people(found.points[row], lot.source)
        figures = report_measurements(found.reports[row])
        made[name] = SolvedVariation(
            motions, figures | _max_trunk_deformation(lot, motions, lot.scales[row])
        )
    return BatchResult(lot.key, made)


def split_people(points: NDArray[np.float64], source: Interaction) -> Motion:
    """``(2, T, J, 3)`` float32: part the points (T, 2 J, 3) of a scene of equal skeletons."""
    shape = (len(points), 2, len(source.skeleton.joints), 3)
    return np.ascontiguousarray(points.reshape(shape).swapaxes(0, 1), dtype=np.float32)


def report_measurements(report: Report) -> dict[str, float]:
    """List a report's figures by name, the energy's terms as ``energy_...``."""
    plain = {name: value for name, value in asdict(report).items() if name != ENERGY}
    terms = {f"{ENERGY}_{name}": value for name, value in report.energy.items()}
    return {name: float(value) for name, value in (plain | terms).items()}


def _max_trunk_deformation(lot: Batch, motions: Motion, scales: Scales) -> dict[str, float]:
    """Measure what the report does not: the worse of the two trunks."""
    people = (lot.source.person_a, lot.source.person_b)
    changes = [
        trunk_deformation(person, motion, lot.source.skeleton, own)
        for person, motion, own in zip(people, motions, np.split(scales, 2), strict=True)
    ]
    return {"trunk_change": max(changes)}


class _SourceKey:
    """A lot that stands for its source: the last one's factorisation serves the next lot too."""

    def __init__(self, lot: Batch) -> None:
        self.lot = lot

    def __hash__(self) -> int:
        return hash((self.lot.key, self.lot.maker))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, _SourceKey):
            return NotImplemented
        return (other.lot.key, other.lot.maker) == (self.lot.key, self.lot.maker)


@lru_cache(maxsize=1)
def _prepared_source(of: _SourceKey) -> PreparedSource:
    return prepare(scene_from(of.lot.source), of.lot.settings)


# FROM """Lots side by side: over this machine's processes, or over a cluster's.
# FROM
# FROM Outcomes come as they are done, in no order; nothing rests on which process made what.
# FROM """
def solve_with_processes(lots: Sequence[Batch], *, processes: int) -> Iterator[BatchResult]:
    """Solve lots on as many processes, at most one a lot; where one will do, it is this one."""
    count = min(processes, len(lots))
    if count <= 1:
        yield from map(solve_batch, longest_first(lots))
        return
    with ProcessExecutor(count) as workers:
        yield from workers.map_unordered(solve_batch, longest_first(lots))


def solve_on_cluster(lots: Sequence[Batch], address: str) -> Iterator[BatchResult]:
    """Solve lots on the workers of a Dask scheduler, which need this package.

    Raises
    ------
    ModuleNotFoundError
        If ``distributed`` is not installed: it is the extra ``dask``.
    """
    with DaskExecutor(address) as cluster:
        yield from cluster.map_unordered(solve_batch, longest_first(lots))


def longest_first(lots: Sequence[Batch]) -> list[Batch]:
    """Order lots so that all workers end at about the same time: what is begun last is short."""
    return sorted(lots, key=lambda lot: -len(lot.source.times) * len(lot.scales))
