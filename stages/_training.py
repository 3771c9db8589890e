"""What the training stages share: clips in, weights and a curve out."""

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import torch
from rich.console import Console
from rich.progress import track
from torch import nn

from pacmo_core.interaction import Interaction
from pacmo_core.pacmo import fit
from pacmo_core.store.weights import write_weights
from stages._clips import stream_side
from stages._files import WEIGHTS, write_curve


def clips_of(clips: Path, sides: Path, side: str) -> list[Interaction]:
    """Hold the clips of one side in memory."""
    return [interaction for _, interaction in stream_side(clips, sides, side)]


def use_threads(threads: int) -> None:
    """Fix how many threads torch uses: another number rounds otherwise."""
    torch.set_num_threads(threads)
    torch.use_deterministic_algorithms(mode=True)


def train(rounds: Iterable[Mapping[str, float]], n_rounds: int, curve: Path) -> None:
    """Train to the end before a progress bar, and write the curve."""
    write_curve(curve, list(_counted(rounds, n_rounds, curve.with_suffix("").as_posix())))


def write_model(folder: Path, kind: str, model: nn.Module, config: Mapping[str, Any]) -> None:
    """Write a trained model with what it takes to build it again."""
    write_weights(folder / WEIGHTS, {"kind": kind, "model": dict(config)}, fit.state(model))


def _counted(
    rounds: Iterable[Mapping[str, float]], n_rounds: int, name: str
) -> Iterator[dict[str, float]]:
    shown = track(rounds, name, n_rounds, console=Console(stderr=True))
    for number, terms in enumerate(shown, start=1):
        yield {"step": number, **terms}
