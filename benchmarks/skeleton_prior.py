"""How fast a trained prior varies a motion, and what a step of its training costs.

Usage: python -m benchmarks.skeleton_prior [--json] [--hidden H]

``vary_ms_batched``: one motion of 363 frames and 25 joints on another body, both people, 32 bodies
at once on two threads; ``vary_ms_single``: one alone. Wall time, best of several: other work on
the machine only adds. ``step_share_of_plain``: process time of a step of training on one thread,
as a share of the same network's written plainly (``tests/skeleton_prior/reference.py``): the same
weights and the same answer, but batches first, frame by frame, a layer a gate, kinematics joint
from joint, nothing folded and nothing known beforehand projected at once, all in float32. Ours
rounds factors of products to bfloat16, as it learns at this size (experiment variations_paper),
where the processor multiplies them; ``exact_step_share_of_plain`` is without. The plain network too
goes faster under torch's autocast, which rounds joints' places by millimetres with all else, so
that nobody would train it so: ``autocast_plain_step_ms``. Shares are medians of steps taken in
turn, with quartiles. Weights are fresh ones: time does not depend on them.
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

N_FRAMES, STRIDE, WINDOW, BATCH = 363, 3, 24, 32
LIMBS = ((4, 5, 6), (8, 9, 10), (12, 13, 14), (16, 17, 18))
WEIGHTS = LossWeights(
    kl_divergence=1e-3, bone_length=1.0, contact_distance=0.5, joint_distance=2.0, acceleration=0.1
)
N_ROUNDS = 3
N_TURNS = 15


def main() -> None:
    """Measure and print."""
    parser = arguments(__doc__ or "")
    parser.add_argument(
        "--hidden", type=int, default=256, help="as params.yaml has it; ours is a quarter"
    )
    options = parser.parse_args()
    keep_freed_memory()  # as the stage that trains does
    figures = varying(options.hidden) | training(options.hidden)
    show(figures, as_json=options.json)


def varying(hidden: int) -> dict[str, float]:
    """Time both decoders over a whole motion."""
    torch.set_num_threads(2)
    model = network(hidden).eval()
    template, scales = scene(N_FRAMES)
    batched = best(lambda: retarget_positions(model, template[0], scales, None, stride=STRIDE))
    single = best(lambda: retarget_positions(model, template[0], scales[:1], None, stride=STRIDE))
    return {"vary_ms_batched": batched / BATCH, "vary_ms_single": single}


def training(hidden: int) -> dict[str, float]:
    """Time a step of ours, rounding factors and not, and of the plain network likewise, in turn."""
    torch.set_num_threads(1)
    ours, plain = network(hidden), make_reference(network(hidden))
    template, scales = scene(WINDOW)
    brief = partial(bfloat16_products, True)
    autocast = partial(torch.autocast, "cpu", torch.bfloat16, enabled=supports_bfloat16("cpu"))
    steps: list[tuple[SkeletonPrior, Precision]] = [
        (ours, brief),
        (ours, nullcontext),
        (plain, nullcontext),
        (plain, autocast),
    ]
    times = in_turn([partial(step, model, template, scales, kind) for model, kind in steps])
    shares = times[:, :2] / times[:, 2:3]
    (low, exact_low), (middle, exact), (high, exact_high) = np.quantile(
        shares, [0.25, 0.5, 0.75], axis=0
    )
    step_ms, exact_ms, plain_ms, autocast_ms = np.median(times, axis=0)
    return {
        "step_share_of_plain": middle,
        "step_share_low": low,
        "step_share_high": high,
        "exact_step_share_of_plain": exact,
        "exact_step_share_low": exact_low,
        "exact_step_share_high": exact_high,
        "step_ms": step_ms,
        "exact_step_ms": exact_ms,
        "plain_step_ms": plain_ms,
        "autocast_plain_step_ms": autocast_ms,
        "has_bfloat16": supports_bfloat16("cpu"),
    }


def network(hidden: int) -> SkeletonPrior:
    """Build our form with fresh weights."""
    model = build_skeleton_prior(PriorConfig(NTU25, LIMBS, "kinematic", hidden, STRIDE, 30.0, 0.0))
    initialise_weights(model, torch.Generator().manual_seed(0))
    return model


def scene(n_frames: int) -> tuple[Tensor, Tensor]:
    """Draw a template (32, T, 2, J, 3), all rows alike, and bodies (32, 2, J)."""
    random = torch.Generator().manual_seed(0)
    pose = torch.rand(2, len(NTU25.joints), 3, generator=random)
    swing = torch.linspace(0, 20, n_frames)[:, None, None, None] + 6 * pose
    template = (pose + 0.1 * swing.sin()).expand(BATCH, n_frames, *pose.shape)
    return template, 0.8 + 0.4 * torch.rand(BATCH, 2, pose.shape[1], generator=random)


def step(model: SkeletonPrior, template: Tensor, scales: Tensor, precision: Precision) -> None:
    """Take the gradient of the loss, the network within a precision."""
    model.zero_grad()
    varied, random = 1.01 * template, torch.Generator().manual_seed(0)
    with precision():
        answer = model.reconstruct(template, scales, varied, random)
    found = loss_terms(answer, varied, template, model.kinematics.parents, model.displacement_scale)
    total_loss(found, WEIGHTS, 1.0).backward()  # type: ignore[no-untyped-call]  # torch's own


def best(run: Callable[[], object]) -> float:
    """Give the least wall time of several runs, after one for warmth, in milliseconds."""
    run()
    found = []
    for _ in range(N_ROUNDS):
        start = time.perf_counter()
        run()
        found.append(time.perf_counter() - start)
    return 1e3 * min(found)


def in_turn(runs: list[Callable[[], None]]) -> NDArray[np.float64]:
    """Give process times of runs taken in turn, (rounds, runs), in milliseconds."""
    found = np.zeros((N_TURNS, len(runs)))
    for row in range(-1, N_TURNS):
        for column, run in enumerate(runs):
            start = time.process_time()
            run()
            if row >= 0:
                found[row, column] = time.process_time() - start
    return 1e3 * found


if __name__ == "__main__":
    main()
