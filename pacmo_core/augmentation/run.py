"""Solves batches of variations in one process, in several, or on a Dask cluster.

A variation does not depend on the others of its batch (tests/augmentation/test_run.py). It can
therefore be cached under the hash of its source, its bodies, and the solver's settings and code.
"""

import hashlib
import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pacmo_core.augmentation.bodies import Scales
from pacmo_core.augmentation.solutions import Solution
from pacmo_core.data.interaction import Interaction, Motion
from pacmo_core.execution import DaskExecutor, ProcessExecutor
from pacmo_core.interaction_mesh import PreparedSource, Report, Scene, Settings, prepare, retarget
from pacmo_core.store.cache import code_hash

# The code that computes a variation; an edit elsewhere keeps the cache valid.
SOLVER_CODE = (
    *("data/skeleton.py", "interaction_mesh/*.py"),
    *("augmentation/run.py", "augmentation/solutions.py", "data/segments.py"),
)
SOLVER_PACKAGES = ("numpy", "scipy")
HASH_LENGTH = 32  # characters


@dataclass(frozen=True)
class Batch:
    """Target bodies of one source.

    Parameters
    ----------
    source_key : hash of the source; equal keys, equal sources
    solver_key : hash of settings and code, which must equal that of the process that solves
    source : the motions of both people
    settings : of the solver
    scales : (V, E) float64, bone scales of person a, then of person b
    body_keys : names of the V bodies
    """

    source_key: str
    solver_key: str
    source: Interaction
    settings: Settings
    scales: Scales
    body_keys: tuple[str, ...]


@dataclass(frozen=True)
class SolvedVariation:
    """A variation.

    Parameters
    ----------
    motions : (2, T, J, 3) float32, metres
    measurements : of the solver's report, by name
    """

    motions: Motion
    measurements: dict[str, float]


@dataclass(frozen=True)
class BatchResult:
    """The variations of a batch by body key, or the error for which there are none."""

    source_key: str
    variations: dict[str, SolvedVariation]
    error: str = ""


def solver_key(settings: Settings) -> str:
    """Hash the solver's settings, its code, and the versions of its packages."""
    text = json.dumps([asdict(settings), code_hash(SOLVER_CODE, SOLVER_PACKAGES)], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:HASH_LENGTH]


def source_key(interaction: Interaction) -> str:
    """Hash a source: motions, frame rate and skeleton, but not the skeleton's name."""
    skeleton = interaction.skeleton
    header = [interaction.fps, skeleton.joints, skeleton.parents, skeleton.left_right]
    digest = hashlib.sha256(json.dumps(header).encode())
    for motion in (interaction.person_a, interaction.person_b):
        digest.update(motion.astype("<f4").tobytes())
    return digest.hexdigest()[:HASH_LENGTH]


def body_key(scales: tuple[Scales, Scales], solution: Solution) -> str:
    """Hash the bone scales of both bodies, and the factors on the solver's weights."""
    digest = hashlib.sha256(json.dumps(asdict(solution)).encode())
    for person_scales in scales:
        digest.update(person_scales.astype("<f8").tobytes())
    return digest.hexdigest()[:HASH_LENGTH]


def solve_with_processes(batches: Sequence[Batch], *, processes: int) -> Iterator[BatchResult]:
    """Solve batches in processes; yield results in order of completion.

    With one process, this process solves them.
    """
    count = min(processes, len(batches))
    if count <= 1:
        yield from map(solve_batch, longest_first(batches))
        return
    with ProcessExecutor(count) as executor:
        yield from executor.map_unordered(solve_batch, longest_first(batches))


def solve_on_cluster(batches: Sequence[Batch], address: str) -> Iterator[BatchResult]:
    """Solve batches on the workers of a Dask scheduler; yield results in order of completion.

    The workers need this package.

    Raises
    ------
    ModuleNotFoundError
        If ``distributed`` is not installed (extra ``dask``).
    """
    with DaskExecutor(address) as executor:
        yield from executor.map_unordered(solve_batch, longest_first(batches))


def longest_first(batches: Sequence[Batch]) -> list[Batch]:
    """Sort batches by descending size, so that all workers finish at about the same time."""
    return sorted(batches, key=lambda batch: -len(batch.source.times) * len(batch.scales))


def solve_batch(batch: Batch) -> BatchResult:
    """Solve a batch; a source that the solver refuses gives a result with an error.

    Raises
    ------
    RuntimeError
        If this process runs other code than the one that made the batch.
    """
    if solver_key(batch.settings) != batch.solver_key:
        raise RuntimeError(
            "this worker runs other code, NumPy or SciPy than the process that made the batch: "
            "restart it"
        )
    try:
        result = retarget(_prepared_source(_SourceKey(batch)), batch.scales)
    except ValueError as fault:
        return BatchResult(batch.source_key, {}, " ".join(str(fault).split()))
    variations = {}
    for row, key in enumerate(batch.body_keys):
        motions = split_people(result.points[row], batch.source)
        variations[key] = SolvedVariation(motions, report_measurements(result.reports[row]))
    return BatchResult(batch.source_key, variations)


def scene_from(interaction: Interaction) -> Scene:
    """Return the scene of an interaction.

    Raises
    ------
    ValueError
        If a body is flat, or a bone has no length.
    """
    motions = (interaction.person_a, interaction.person_b)
    return Scene(motions, (interaction.skeleton,) * 2, interaction.fps)


def split_people(points: NDArray[np.float64], source: Interaction) -> Motion:
    """Split a scene's points (T, 2 J, 3) into motions ``(2, T, J, 3)`` float32, metres."""
    shape = (len(points), 2, len(source.skeleton.joints), 3)
    return np.ascontiguousarray(points.reshape(shape).swapaxes(0, 1), dtype=np.float32)


def report_measurements(report: Report) -> dict[str, float]:
    """List a report's measurements by name."""
    return {name: float(value) for name, value in asdict(report).items()}


class _SourceKey:
    """Argument of ``_prepared_source``: a batch, compared by its source and solver only."""

    def __init__(self, batch: Batch) -> None:
        self.batch = batch

    def __hash__(self) -> int:
        return hash((self.batch.source_key, self.batch.solver_key))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, _SourceKey):
            return NotImplemented
        return (other.batch.source_key, other.batch.solver_key) == (
            self.batch.source_key,
            self.batch.solver_key,
        )


# The factorisation of the last batch's source serves the next batch of the same source.
@lru_cache(maxsize=1)
def _prepared_source(key: _SourceKey) -> PreparedSource:
    return prepare(scene_from(key.batch.source), key.batch.settings)
