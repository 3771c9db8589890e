"""Speed of the operator against UNO of neuraloperator, and cost of reactions.

Usage: python -m benchmarks.operator [--json]

``speedup_t64``, ``speedup_t256``: time of the peer's forward and backward pass over that of ours;
width 64, batch 16, 150 to 69 channels, the same seven grids and modes, one thread, in turn.
``reaction_ms``: from 64 frames of a partner to the reaction, encoding included, by a generator of
the shape that the pipeline trains (``params.yaml``, ``train_pacmo``); ``reaction_wide_ms``: by one
of width 64; ``finish_ms``, ``finish_ms_t256``: the finish of a reaction of 64 and of 256 frames,
included in none of the others; ``stream_ms_per_frame``: one frame of a live partner, with exact
bones, by the shape that is trained; ``stream_wide_ms_per_frame``: by one of width 64; ``long_s``,
``long_mb``: one partner of 48,000 frames in one call, in a process of its own: seconds, and peak
resident memory above that before the call. These two are of width 64.
The weights are fresh ones: time does not depend on them. On one thread
times are process times, which other work on the machine disturbs least. Without the peer
(``pip install neuraloperator==2.0.0``, or the extra ``peers``) its two figures are left out.
"""

import json
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import torch

from benchmarks._figures import arguments, show
from benchmarks._networks import (
    FPS,
    SECONDS,
    WIDE,
    generator,
    our_operator,
    partner,
    trained_shape,
)
from benchmarks._peer import peer_operator
from pacmo_core.reaction.generator import Generator
from pacmo_core.reaction.inference import finish_reactions, react
from pacmo_core.reaction.stream import ReactionStream
from pacmo_core.reaction.windows import PartnerMotion

BATCH, CHANNELS_IN, CHANNELS_OUT = 16, 150, 69
LONG_FRAMES = 48_000
N_ROUNDS = 15


def main() -> None:
    """Measure and print."""
    parser = arguments(__doc__ or "")
    parser.add_argument("--long", action="store_true", help="only measure the long partner")
    options = parser.parse_args()
    if options.long:
        print(json.dumps(long_partner(LONG_FRAMES)))
        return
    torch.set_num_threads(1)
    figures = {f"{name}_t{n}": value for n in (64, 256) for name, value in beside_peer(n).items()}
    figures |= reaction() | finishing() | stream() | in_new_process()
    show(figures, as_json=options.json)


def beside_peer(n_frames: int) -> dict[str, float]:
    """Time a forward and backward pass of ours and of the peer, in turn."""
    ours = our_operator(CHANNELS_IN, CHANNELS_OUT)
    random = torch.Generator().manual_seed(0)
    on_grid = torch.randn(BATCH, WIDE.n_points, CHANNELS_IN, generator=random)
    frames = torch.randn(BATCH, n_frames, CHANNELS_IN, generator=random)
    times = torch.linspace(0, 1, n_frames)

    def run_ours() -> None:
        out = ours.evaluate(ours.trunk(on_grid), frames, ours.evaluation(times))
        descend(ours, out)

    peer = peer_operator(CHANNELS_IN, CHANNELS_OUT)
    if peer is None:
        return {"ours_ms": medians([run_ours])[0]}
    there = frames.transpose(1, 2).contiguous()
    our_ms, peer_ms = medians([run_ours, lambda: descend(peer, peer(there))])
    return {"speedup": peer_ms / our_ms, "ours_ms": our_ms, "peer_ms": peer_ms}


def descend(network: torch.nn.Module, out: torch.Tensor) -> None:
    """Compute the gradient of a simple loss for all weights."""
    network.zero_grad()
    out.square().mean().backward()  # type: ignore[no-untyped-call]  # torch leaves it untyped


def reaction() -> dict[str, float]:
    """Time one reaction to one partner of 64 frames, by a trained shape and by the wide one."""
    motion, times = partner(64)

    def by(model: Generator) -> Callable[[], None]:
        def run() -> None:
            random = torch.Generator().manual_seed(0)
            react(model, motion, times, out_times=times, n_samples=1, random=random)

        return run

    # One after the other: alternate runs would evict each other's weights from the caches.
    (trained,), (wide,) = (medians([by(generator(shape))]) for shape in (trained_shape(), WIDE))
    return {"reaction_ms": trained, "reaction_wide_ms": wide}


def finishing() -> dict[str, float]:
    """Time the finish of a body that sways beside the partner, arms within reach."""

    def of(n_frames: int) -> Callable[[], None]:
        motion, times = partner(n_frames)
        query, shift = PartnerMotion(motion, times, times), np.array([0, 0, 0.3], np.float32)
        model, reactions = generator(trained_shape()), (motion[::-1] + shift)[None]

        def run() -> None:
            finish_reactions(model, query, reactions)

        return run

    short, long = medians([of(64), of(256)])
    return {"finish_ms": short, "finish_ms_t256": long}


def stream() -> dict[str, float]:
    """Time the frames of a live partner, once the window is full."""
    motion, times = partner(round(3 * SECONDS * FPS))

    def by(model: Generator) -> float:
        random = torch.Generator().manual_seed(0)
        live = ReactionStream(model, n_samples=1, random=random, finish=True)
        taken = []
        for pose, instant in zip(motion, times, strict=True):
            start = time.process_time()
            live.react(pose, float(instant))
            taken.append(1e3 * (time.process_time() - start))
        return statistics.median(taken[len(taken) // 2 :])

    return {
        "stream_ms_per_frame": by(generator(trained_shape())),
        "stream_wide_ms_per_frame": by(generator(WIDE)),
    }


def in_new_process() -> dict[str, float]:
    """Run the long partner in a new process."""
    command = [sys.executable, "-m", "benchmarks.operator", "--long"]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
    figures: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return figures


def long_partner(n_frames: int) -> dict[str, float]:
    """React to one long partner, with torch's number of threads."""
    model, (motion, times) = generator(WIDE), partner(n_frames)
    random = torch.Generator().manual_seed(0)
    before, start = resident("VmRSS"), time.perf_counter()
    motions = react(model, motion, times, out_times=times, n_samples=1, random=random)
    seconds = time.perf_counter() - start
    if not np.isfinite(motions).all():
        raise FloatingPointError("the long reaction is not finite")
    return {"long_s": seconds, "long_mb": resident("VmHWM") - before}


def resident(which: str) -> float:
    """Return the resident memory in megabytes: now (``VmRSS``) or peak (``VmHWM``)."""
    with Path("/proc/self/status").open() as lines:
        (line,) = (line for line in lines if line.startswith(which))
    return int(line.split()[1]) / 1e3


def medians(runs: Sequence[Callable[[], None]]) -> list[float]:
    """Return medians of process time in milliseconds; runs alternate, after two warm-up rounds."""
    taken: list[list[float]] = [[] for _ in runs]
    for number in range(N_ROUNDS + 2):
        for run, times in zip(runs, taken, strict=True):
            start = time.process_time()
            run()
            if number >= 2:
                times.append(1e3 * (time.process_time() - start))
    return [statistics.median(times) for times in taken]


if __name__ == "__main__":
    main()
