"""Inference time of a skeleton prior, and the cost of a training step.

Usage: python -m benchmarks.skeleton_prior [--json] [--hidden H]

``retarget_ms_batched``: a motion of 363 frames and 25 joints on other skeletons, both people, in
batches of 32 on two threads; ``retarget_ms_single``: one alone. Wall time, the least of several
runs: other work on the machine only adds.

``step_share_of_reference``: processor time of a training step on one thread, relative to the
reference implementation of the same network (``tests/skeleton_prior/reference.py``): same weights
and results, but batch first, frame by frame, one linear layer per gate, forward kinematics joint by
joint, nothing folded or projected in advance, in float32. The step uses bfloat16 products where the
processor supports them, as in the experiment ``variations_paper``;
``float32_step_share_of_reference`` does not. ``autocast_reference_step_ms`` is the reference under
torch's autocast, which rounds joint positions by millimetres and so is no alternative. Shares are
medians of steps taken in turn, with quartiles. Weights are untrained: time does not depend on them.
"""

import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from functools import partial

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from benchmarks._figures import arguments, show
from pacmo_core.data.skeleton import NTU25
from pacmo_core.models import build_skeleton_prior
from pacmo_core.skeleton_prior.autograd_functions import bfloat16_products, supports_bfloat16
from pacmo_core.skeleton_prior.inference import retarget_positions
from pacmo_core.skeleton_prior.layers import initialise_weights
from pacmo_core.skeleton_prior.losses import loss_terms, total_loss
from pacmo_core.skeleton_prior.settings import LossWeights, PriorConfig
from pacmo_core.skeleton_prior.vae import SkeletonPrior
from pacmo_core.training.devices import keep_freed_memory
from tests.skeleton_prior.reference import make_reference

Precision = Callable[[], AbstractContextManager[object]]

N_FRAMES, STRIDE, WINDOW, BATCH_SIZE = 363, 3, 24, 32
LIMBS = ((4, 5, 6), (8, 9, 10), (12, 13, 14), (16, 17, 18))
WEIGHTS = LossWeights(
    kl_divergence=1e-3, bone_length=1.0, contact_distance=0.5, joint_distance=2.0, acceleration=0.1
)
N_RUNS = 3
N_ROUNDS = 15


def main() -> None:
    """Measure and print."""
    parser = arguments(__doc__ or "")
    parser.add_argument(
        "--hidden", type=int, default=256, help="of params.yaml; the kinematic model uses a quarter"
    )
    options = parser.parse_args()
    keep_freed_memory()  # as the training stage does
    figures = time_inference(options.hidden) | time_training(options.hidden)
    show(figures, as_json=options.json)


def time_inference(hidden: int) -> dict[str, float]:
    """Time retargeting of a whole motion."""
    torch.set_num_threads(2)
    model = network(hidden).eval()
    template, scales = random_batch(N_FRAMES)
    batched = min_wall_ms(
        lambda: retarget_positions(model, template[0], scales, None, stride=STRIDE)
    )
    single = min_wall_ms(
        lambda: retarget_positions(model, template[0], scales[:1], None, stride=STRIDE)
    )
    return {"retarget_ms_batched": batched / BATCH_SIZE, "retarget_ms_single": single}


def time_training(hidden: int) -> dict[str, float]:
    """Time a training step in both precisions, and of the reference likewise, in turn."""
    torch.set_num_threads(1)
    model, reference = network(hidden), make_reference(network(hidden))
    template, scales = random_batch(WINDOW)
    mixed = partial(bfloat16_products, enabled=True)
    autocast = partial(torch.autocast, "cpu", torch.bfloat16, enabled=supports_bfloat16("cpu"))
    steps: list[tuple[SkeletonPrior, Precision]] = [
        (model, mixed),
        (model, nullcontext),
        (reference, nullcontext),
        (reference, autocast),
    ]
    times = processor_ms([partial(step, network, template, scales, p) for network, p in steps])
    shares = times[:, :2] / times[:, 2:3]
    (low, float32_low), (median, float32), (high, float32_high) = np.quantile(
        shares, [0.25, 0.5, 0.75], axis=0
    )
    step_ms, float32_ms, reference_ms, autocast_ms = np.median(times, axis=0)
    return {
        "step_share_of_reference": median,
        "step_share_low": low,
        "step_share_high": high,
        "float32_step_share_of_reference": float32,
        "float32_step_share_low": float32_low,
        "float32_step_share_high": float32_high,
        "step_ms": step_ms,
        "float32_step_ms": float32_ms,
        "reference_step_ms": reference_ms,
        "autocast_reference_step_ms": autocast_ms,
        "supports_bfloat16": supports_bfloat16("cpu"),
    }


def network(hidden: int) -> SkeletonPrior:
    """Build an untrained kinematic model."""
    model = build_skeleton_prior(PriorConfig(NTU25, LIMBS, "kinematic", hidden, STRIDE, 30.0, 0.0))
    initialise_weights(model, torch.Generator().manual_seed(0))
    return model


def random_batch(n_frames: int) -> tuple[Tensor, Tensor]:
    """Sample a template (32, T, 2, J, 3), equal in all rows, and scales (32, 2, J)."""
    random = torch.Generator().manual_seed(0)
    pose = torch.rand(2, len(NTU25.joints), 3, generator=random)
    phase = torch.linspace(0, 20, n_frames)[:, None, None, None] + 6 * pose
    template = (pose + 0.1 * phase.sin()).expand(BATCH_SIZE, n_frames, *pose.shape)
    return template, 0.8 + 0.4 * torch.rand(BATCH_SIZE, 2, pose.shape[1], generator=random)


def step(model: SkeletonPrior, template: Tensor, scales: Tensor, precision: Precision) -> None:
    """Compute the gradient of the loss, the network in a precision."""
    model.zero_grad()
    variation, random = 1.01 * template, torch.Generator().manual_seed(0)
    with precision():
        result = model.reconstruct(template, scales, variation, random)
    parents, displacement_scale = model.kinematics.parents, model.displacement_scale
    terms = loss_terms(result, variation, template, parents, displacement_scale)
    total_loss(terms, WEIGHTS, 1.0).backward()  # type: ignore[no-untyped-call]  # torch's own


def min_wall_ms(run: Callable[[], object]) -> float:
    """Return the least wall time of several runs, after a warm-up, in milliseconds."""
    run()
    times = []
    for _ in range(N_RUNS):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return 1e3 * min(times)


def processor_ms(runs: list[Callable[[], None]]) -> NDArray[np.float64]:
    """Return processor times of runs taken in turn, (rounds, runs), in milliseconds."""
    times = np.zeros((N_ROUNDS, len(runs)))
    for row in range(-1, N_ROUNDS):
        for column, run in enumerate(runs):
            start = time.process_time()
            run()
            if row >= 0:
                times[row, column] = time.process_time() - start
    return 1e3 * times


if __name__ == "__main__":
    main()
