"""How fast a trained prior varies a motion, and what a step of its training costs.

Usage: python -m benchmarks.skeleton_prior [--json] [--hidden H]

``vary_ms_batched``: one motion of 363 frames and 25 joints on another body, both people, 32 bodies
at once on two threads; ``vary_ms_single``: one alone. Wall time, best of several: other work on
the machine only adds. ``step_share_of_plain``: process time of a step of training on one thread,
as a share of the same network's written plainly: the same weights and the same answer, but frame
by frame, a layer a gate, joint from joint, torch's own convolution, nothing folded and nothing
known beforehand projected at once.
Weights are fresh ones: time does not depend on them.
"""

import statistics
import time
from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor, nn

from benchmarks._figures import arguments, show
from pacmo_core.skeleton import NTU25
from pacmo_core.skeleton_prior.forms import build
from pacmo_core.skeleton_prior.initialise import initialise
from pacmo_core.skeleton_prior.kinematic import KinematicCharacter
from pacmo_core.skeleton_prior.losses import LossWeights, terms, total
from pacmo_core.skeleton_prior.model import PriorConfig, SkeletonPrior
from pacmo_core.skeleton_prior.vary import forward
from tests.skeleton_prior.plain import PlainConvolution, PlainGru, PlainHead, PlainTime, PlainTree

N_FRAMES, STRIDE, WINDOW, BATCH = 363, 3, 24, 32
LIMBS = ((4, 5, 6), (8, 9, 10), (12, 13, 14), (16, 17, 18))
WEIGHTS = LossWeights(
    divergence=1e-3, bodies=0.1, bones=1.0, pairs=0.5, distances=2.0, acceleration=0.1
)
N_ROUNDS = 3


def main() -> None:
    """Measure and print."""
    parser = arguments(__doc__ or "")
    parser.add_argument(
        "--hidden", type=int, default=256, help="as params.yaml has it; ours is a quarter"
    )
    options = parser.parse_args()
    figures = varying(options.hidden) | training(options.hidden)
    show(figures, as_json=options.json)


def varying(hidden: int) -> dict[str, float]:
    """Time both decoders over a whole motion."""
    torch.set_num_threads(2)
    model = network(hidden).eval()
    template, scales = scene(N_FRAMES)
    batched = best(lambda: forward(model, template[0], scales, None))
    single = best(lambda: forward(model, template[0], scales[:1], None))
    return {"vary_ms_batched": batched / BATCH, "vary_ms_single": single}


def training(hidden: int) -> dict[str, float]:
    """Time a step of ours and of the plain network, in turn."""
    torch.set_num_threads(1)
    ours, plain = network(hidden), made_plain(network(hidden))
    template, scales = scene(WINDOW)
    times = rounds([lambda: step(ours, template, scales), lambda: step(plain, template, scales)])
    return {
        "step_share_of_plain": times[0] / times[1],
        "step_ms": times[0],
        "plain_step_ms": times[1],
    }


def network(hidden: int) -> SkeletonPrior:
    """Build our form with fresh weights."""
    model = build(PriorConfig(NTU25, LIMBS, "kinematic", hidden, STRIDE, 0.0))
    initialise(model, torch.Generator().manual_seed(0))
    return model


def made_plain(model: SkeletonPrior) -> SkeletonPrior:
    """Write the layers of a network plainly, their weights kept."""
    for character in (model.first, model.second):
        if not isinstance(character, KinematicCharacter):
            raise TypeError(f"wanted our form; got {type(character).__name__}")
        tree = PlainTree(model.config.skeleton, model.config.limbs)
        replace(character, "tree", tree)
        replace(character, "place", tree)
        replace(character, "recurrent", PlainGru(character.recurrent))
        replace(character, "head", PlainHead(character.head))
        for layer in [*character.encoder.layers, *character.around]:
            replace(layer, "graph", PlainConvolution(layer.graph))
            replace(layer, "time", PlainTime(layer.time))
    return model


def replace(module: nn.Module, name: str, part: nn.Module) -> None:
    """Put another part in the place of one."""
    module.add_module(name, part)


def scene(n_frames: int) -> tuple[Tensor, Tensor]:
    """Draw a template (32, T, 2, J, 3), all rows alike, and bodies (32, 2, J)."""
    random = torch.Generator().manual_seed(0)
    pose = torch.rand(2, len(NTU25.joints), 3, generator=random)
    swing = torch.linspace(0, 20, n_frames)[:, None, None, None] + 6 * pose
    template = (pose + 0.1 * swing.sin()).expand(BATCH, n_frames, *pose.shape)
    return template, 0.8 + 0.4 * torch.rand(BATCH, 2, pose.shape[1], generator=random)


def step(model: SkeletonPrior, template: Tensor, scales: Tensor) -> None:
    """Take the gradient of the loss."""
    model.zero_grad()
    answer = model.reconstruct(template, scales, 1.01 * template, torch.Generator().manual_seed(0))
    found = terms(answer, 1.01 * template, template, model.tree.parents, model.unit)
    total(found, WEIGHTS, 1.0).backward()  # type: ignore[no-untyped-call]  # torch's own


def best(run: Callable[[], object]) -> float:
    """Give the least wall time of several runs, after one for warmth, in milliseconds."""
    run()
    found = []
    for _ in range(N_ROUNDS):
        start = time.perf_counter()
        run()
        found.append(time.perf_counter() - start)
    return 1e3 * min(found)


def rounds(runs: list[Callable[[], None]]) -> list[float]:
    """Give median process times of runs taken in turn, in milliseconds."""
    found = np.zeros((N_ROUNDS, len(runs)))
    for row in range(-1, N_ROUNDS):
        for column, run in enumerate(runs):
            start = time.process_time()
            run()
            if row >= 0:
                found[row, column] = time.process_time() - start
    return [1e3 * statistics.median(found[:, column].tolist()) for column in range(len(runs))]


if __name__ == "__main__":
    main()
