"""The cost of variations by frames and by variations, in numbers and a figure."""

import resource
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from benchmarks._retargeting_tasks import SETTINGS, Task
from pacmo_core.interaction_mesh import Scene, prepare, retarget_in_batches

FRAMES = (90, 360, 1440, 5760, 36_000)
VARIATIONS = (1, 16, 48, 144, 1000)
N_FRAMES_OF_VARIATIONS = 90  # frames of the motion of which VARIATIONS are made


@dataclass(frozen=True)
class Cost:
    """Process seconds and peak memory of one task in a process of its own."""

    n_frames: int
    n_variations: int
    seconds: float
    peak_mb: float


def measure_cost(task: Task) -> Cost:
    """Measure the cost of a task; its variations are dropped."""
    start = time.process_time()
    for _ in retarget_in_batches(prepare(task.scene, SETTINGS), task.scales):
        pass
    seconds = time.process_time() - start
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    return Cost(len(task.scene.points), len(task.scales), seconds, peak)


def measure_costs(task: Task) -> Iterator[Cost]:
    """Measure one variation of motions of FRAMES, then VARIATIONS of a short motion."""
    one, many = task.scales[-1:], np.resize(task.scales, (max(VARIATIONS), task.scales.shape[1]))
    longer = [replace(task, scene=repeat_motion(task.scene, t), scales=one) for t in FRAMES]
    short = repeat_motion(task.scene, N_FRAMES_OF_VARIATIONS)
    more = [replace(task, scene=short, scales=many[:count]) for count in VARIATIONS]
    for each in (*longer, *more):
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
            yield pool.submit(measure_cost, each).result()


def repeat_motion(scene: Scene, n_frames: int) -> Scene:
    """Repeat a motion forwards and backwards to a number of frames."""
    forwards = np.arange(len(scene.points))
    order = np.resize(np.concatenate([forwards, forwards[-2:0:-1]]), n_frames)
    first, second = (motion[order] for motion in scene.motions)
    return Scene((first, second), scene.skeletons, scene.fps)


def draw_costs(measured: list[Cost], path: Path) -> None:
    """Draw both costs, each with a line in proportion to its last."""
    figure = Figure(figsize=(9, 3.6), layout="constrained")
    names = ("frames, one variation", f"variations of {N_FRAMES_OF_VARIATIONS} frames")
    parts = measured[: len(FRAMES)], measured[len(FRAMES) :]
    for axes, name, part in zip(figure.subplots(1, 2), names, parts, strict=True):
        counts = [c.n_frames if part is parts[0] else c.n_variations for c in part]
        power = f"measured; finally with exponent {growth_exponent(part):.2f}"
        axes.loglog(counts, [c.seconds for c in part], "o-", label=power)
        straight = part[-1].seconds * np.array(counts) / counts[-1]
        axes.loglog(counts, straight, "--", label="in proportion")
        axes.set(xlabel=name, ylabel="process seconds")
        axes.legend()
    figure.savefig(path, dpi=120)


def growth_exponent(part: list[Cost]) -> float:
    """Return the exponent with which seconds grow with the count, from the last three."""
    sizes = [cost.n_frames * cost.n_variations for cost in part[-3:]]
    slope, _ = np.polyfit(np.log(sizes), np.log([cost.seconds for cost in part[-3:]]), 1)
    return float(slope)
