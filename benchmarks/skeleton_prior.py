"""Inference time of a skeleton prior beside the solver's, and the cost of a training step.

Usage: python -m benchmarks.skeleton_prior [--json] [--hidden H]

A motion of 363 frames is retargeted to other bodies, both people, by the kinematic model and by
InteractionMesh, end to end but for reading and writing. ``vary_ms_batched`` and ``solver_ms`` are
the time of a body in a batch of 32, ``vary_ms_single`` and ``solver_ms_single`` that of one body
alone; the solver's with preparation and all attempts. Wall time on two threads, the least of
several runs, but the solver's batch once: other work on the machine only adds. The motion is the
first of ``_retargeting_tasks``, recorded if ``PACMO_REAL_DATA`` names the captures.

``step_ms``: processor time of a training step of 32 windows of 24 keyframes on one thread, the
median. Weights are untrained: time does not depend on them.
"""

import time
from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray
from ruamel.yaml import YAML
from torch import Tensor

from benchmarks._figures import arguments, show
from benchmarks._retargeting_tasks import PARAMS, SETTINGS, Task, retargeting_tasks
from pacmo_core.data.interaction import Interaction
from pacmo_core.interaction_mesh import prepare
from pacmo_core.interaction_mesh import retarget as retarget_by_optimisation
from pacmo_core.models import build_skeleton_prior
from pacmo_core.skeleton_prior.data import ExampleBatch, canonical_frame, stack_characters
from pacmo_core.skeleton_prior.inference import retarget
from pacmo_core.skeleton_prior.kinematics import find_limbs
from pacmo_core.skeleton_prior.layers import initialise_weights
from pacmo_core.skeleton_prior.settings import LossWeights, PriorConfig, StartSettings
from pacmo_core.skeleton_prior.training import weighted_loss
from pacmo_core.skeleton_prior.vae import SkeletonPrior
from pacmo_core.training.devices import keep_freed_memory

N_BODIES, STRIDE, WINDOW = 32, 3, 24
N_RUNS, N_STEPS = 3, 9
SECTION = YAML(typ="safe").load(PARAMS)["train_skeleton_prior"]


def main() -> None:
    """Measure and print."""
    parser = arguments(__doc__ or "")
    parser.add_argument(
        "--hidden", type=int, default=256, help="of params.yaml; the kinematic model uses a quarter"
    )
    options = parser.parse_args()
    keep_freed_memory()  # as the training stage does
    torch.set_num_threads(2)
    _, (task, *_) = retargeting_tasks()
    source = Interaction(
        task.scene.skeletons[0],
        np.arange(len(task.scene.motions[0])) / task.scene.fps,
        *task.scene.motions,
    )
    model = network(source, options.hidden)
    figures = time_inference(model, source, task) | time_solver(task)
    torch.set_num_threads(1)
    show(figures | time_training(model, source), as_json=options.json)


def network(source: Interaction, hidden: int) -> SkeletonPrior:
    """Build an untrained kinematic model."""
    limbs, start = find_limbs(source.skeleton, source.person_a), StartSettings(**SECTION["start"])
    config = PriorConfig(source.skeleton, limbs, "kinematic", hidden, STRIDE, source.fps, start)
    model = build_skeleton_prior(config).eval()
    initialise_weights(model, torch.Generator().manual_seed(0))
    return model


def time_inference(model: SkeletonPrior, source: Interaction, task: Task) -> dict[str, float]:
    """Time the model."""

    def run(n_bodies: int) -> None:
        list(retarget(model, source, bodies(task, n_bodies), samples=1, random=None))

    batched = min_wall_ms(lambda: run(N_BODIES)) / N_BODIES
    return {"vary_ms_batched": batched, "vary_ms_single": min_wall_ms(lambda: run(1))}


def time_solver(task: Task) -> dict[str, float]:
    """Time InteractionMesh on the same bodies."""

    def run(n_bodies: int) -> None:
        scales = bodies(task, n_bodies).reshape(n_bodies, -1)
        retarget_by_optimisation(prepare(task.scene, SETTINGS), scales)

    single = min_wall_ms(lambda: run(1))
    start = time.perf_counter()
    run(N_BODIES)
    batched = 1e3 * (time.perf_counter() - start) / N_BODIES
    return {"solver_ms": batched, "solver_ms_single": single}


def bodies(task: Task, n: int) -> NDArray[np.float64]:
    """Select the scales (n, 2, E) of bodies spread over the task's."""
    rows = np.linspace(0, len(task.scales) - 1, n).round().astype(int)
    scales: NDArray[np.float64] = task.scales[rows].reshape(n, 2, -1)
    return scales


def time_training(model: SkeletonPrior, source: Interaction) -> dict[str, float]:
    """Time the gradient of the loss of one batch."""
    motion = stack_characters(source, canonical_frame(source), b_first=True)
    template = motion[: WINDOW * STRIDE : STRIDE].expand(N_BODIES, -1, -1, -1, -1)
    random = torch.Generator().manual_seed(0)
    scales = 0.8 + 0.4 * torch.rand(N_BODIES, 2, template.shape[3], generator=random)
    model.train()
    times = []
    for _ in range(N_STEPS):
        start = time.process_time()
        step(model, template, scales, random)
        times.append(time.process_time() - start)
    return {"step_ms": 1e3 * float(np.median(times))}


def step(model: SkeletonPrior, template: Tensor, scales: Tensor, random: torch.Generator) -> None:
    """Compute the gradient of the loss."""
    model.zero_grad()
    variation = 1.01 * template
    as_used = torch.arange(N_BODIES) % 2 == 0
    motions, posteriors = model.reconstruct(template, scales, variation, as_used, random)
    weights = LossWeights(**SECTION["loss_weights"])
    batch = ExampleBatch(template, variation, scales)
    loss = weighted_loss(model, batch, motions, posteriors, weights)
    loss.backward()  # type: ignore[no-untyped-call]  # torch's own


def min_wall_ms(run: Callable[[], object]) -> float:
    """Return the least wall time of several runs, after a warm-up, in milliseconds."""
    run()
    times = []
    for _ in range(N_RUNS):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return 1e3 * min(times)


if __name__ == "__main__":
    main()
