"""How the cost of variations grows with frames and with variations, as figures and a picture."""

import resource
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from benchmarks._variations import SETTINGS, Task
from pacmo_core.interaction_mesh import Scene, prepare, retarget_in_batches

FRAMES = (90, 360, 1440, 5760, 36_000)
VARIATIONS = (1, 16, 48, 144, 1000)
FEW = 90  # frames for which variations are counted


@dataclass(frozen=True)
class Cost:
    """Process seconds and the most memory that one task took in a process of its own."""

    n_frames: int
    n_variations: int
    seconds: float
    peak_mb: float


def measure(task: Task) -> Cost:
    """Vary, drop what comes out, and say what it took."""
    start = time.process_time()
    for _ in retarget_in_batches(prepare(task.scene, SETTINGS), task.scales):
        pass
    seconds = time.process_time() - start
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    return Cost(len(task.scene.points), len(task.scales), seconds, peak)


def costs(task: Task) -> Iterator[Cost]:
    """Measure one variation of longer and longer motions, then more and more of a short one."""
    one, many = task.scales[-1:], np.resize(task.scales, (max(VARIATIONS), task.scales.shape[1]))
    longer = [replace(task, scene=lasting(task.scene, t), scales=one) for t in FRAMES]
    short = lasting(task.scene, FEW)
    more = [replace(task, scene=short, scales=many[:count]) for count in VARIATIONS]
    for each in (*longer, *more):
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
            yield pool.submit(measure, each).result()


def lasting(scene: Scene, n_frames: int) -> Scene:
    """Play the motion there and back until it has lasted long enough."""
    there = np.arange(len(scene.points))
    order = np.resize(np.concatenate([there, there[-2:0:-1]]), n_frames)
    first, second = (motion[order] for motion in scene.motions)
    return Scene((first, second), scene.skeletons, scene.fps)


def draw(measured: list[Cost], path: Path) -> None:
    """Draw both, with a straight line through the origin beside them."""
    figure = Figure(figsize=(9, 3.6), layout="constrained")
    names = ("frames, one variation", f"variations of {FEW} frames")
    parts = measured[: len(FRAMES)], measured[len(FRAMES) :]
    for axes, name, part in zip(figure.subplots(1, 2), names, parts, strict=True):
        counts = [c.n_frames if part is parts[0] else c.n_variations for c in part]
        power = f"measured; in the end as power {growth(part):.2f}"
        axes.loglog(counts, [c.seconds for c in part], "o-", label=power)
        straight = part[-1].seconds * np.array(counts) / counts[-1]
        axes.loglog(counts, straight, "--", label="in proportion")
        axes.set(xlabel=name, ylabel="process seconds")
        axes.legend()
    figure.savefig(path, dpi=120)


def growth(part: list[Cost]) -> float:
    """Give the power of the count with which seconds grow, from the last but two on."""
    sizes = [cost.n_frames * cost.n_variations for cost in part[-3:]]
    slope, _ = np.polyfit(np.log(sizes), np.log([cost.seconds for cost in part[-3:]]), 1)
    return float(slope)
