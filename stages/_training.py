"""What the training stages share: clips in; weights, a curve and, on the way, checkpoints out."""

import argparse
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Protocol

import torch
import torch.distributed as dist
from rich.console import Console
from rich.progress import track

from pacmo_core.data.interaction import Interaction
from pacmo_core.models import MODELS, Model
from pacmo_core.store.weights import write_weights
from pacmo_core.training.checkpoints import Checkpoint, data_hash
from pacmo_core.training.devices import is_main_process, training_device
from pacmo_core.training.loop import TrainingData, TrainingLoop
from pacmo_core.training.state import model_config, model_state
from stages._clips import stream_side
from stages._files import WEIGHTS, write_curve
from stages._live import live_curve


class TrainingParams(Protocol):
    """What every training section of ``params.yaml`` says besides its model."""

    @property
    def threads(self) -> int:
        """Of torch."""

    @property
    def device(self) -> str:
        """Where to train: cpu, cuda or auto."""

    @property
    def checkpoint_every(self) -> int:
        """Epochs."""


@dataclass(frozen=True)
class Task:
    """One model's training.

    Parameters
    ----------
    model : row of the registry
    params : the model's section of ``params.yaml``
    data : clips that the model is trained and selected on; their hashes stand beside the weights
    build : device to a training loop
    """

    model: Model
    params: TrainingParams
    data: TrainingData[Interaction]
    build: Callable[[str], TrainingLoop[Any]]


def read_training_data(clips: Path, sides: Path) -> TrainingData[Interaction]:
    """Read a fold's training and validation clips into memory."""
    train, validation = (list(stream_side(clips, sides, side)) for side in ("train", "validation"))
    return TrainingData(
        [interaction for _, interaction in train],
        [interaction for _, interaction in validation],
        [facts.action for facts, _ in train],
        [facts.action for facts, _ in validation],
    )


def train_on_clips(name: str, params: TrainingParams, paths: argparse.Namespace) -> None:
    """Train a model of reactions or features on a fold's clips.

    Parameters
    ----------
    name : of the model, in the registry
    params : its section of ``params.yaml``
    paths : clips, sides, model and curve
    """
    model, data = MODELS[name], read_training_data(paths.clips, paths.sides)
    task = Task(
        model, params, data, lambda device: model.build_training(data, params, device=device)
    )
    train(task, paths.model, paths.curve)


def train(task: Task, model: Path, curve: Path) -> None:
    """Train, from the last checkpoint if there is one; write weights into ``model``, and the curve.

    Killed and started again, it writes the bytes that it would have written uninterrupted, on a
    CPU.
    """
    params = task.params
    with training_device(
        params.device, threads=params.threads, multiprocess=task.model.multiprocess
    ) as device:
        fitting = task.build(device)
        facts = _facts(task, fitting)
        stage = f"train_{task.model.name}"
        checkpoint = Checkpoint(stage, {**facts, **_place(device)}, task.model.package)
        checkpoint.resume(fitting)
        if is_main_process():
            _train_watched(fitting, checkpoint, params.checkpoint_every, model)
            write_curve(curve, _rows(fitting.curve))
            selection = {"selection": fitting.selection()}
            write_weights(model / WEIGHTS, facts | selection, model_state(fitting.model))
            checkpoint.remove()
        else:
            fitting.finish()


def _facts(task: Task, fitting: TrainingLoop[Any]) -> dict[str, Any]:
    return {
        "model": task.model.name,
        "config": model_config(fitting.model),
        "settings": asdict(task.params),  # type: ignore[call-overload]  # a dataclass, see Params
        "data": {
            "train": data_hash(task.data.train),
            "validation": data_hash(task.data.validation),
        },
        # Without the name of the build, by which equal results would differ.
        "torch": torch.__version__.partition("+")[0],
    }


def _place(device: str) -> dict[str, Any]:
    n_processes = dist.get_world_size() if dist.is_initialized() else 1
    return {"device": device.partition(":")[0], "processes": n_processes}


def _train_watched(
    fitting: TrainingLoop[Any], checkpoint: Checkpoint, every: int, model: Path
) -> None:
    done = len(fitting.curve)
    console = Console(stderr=True)
    with live_curve(model, fitting.curve) as live:
        shown = track(fitting, checkpoint.stage, fitting.n_epochs, completed=done, console=console)
        for epoch, terms in enumerate(shown, start=done + 1):
            live.add(epoch, terms)
            if epoch % every == 0:
                checkpoint.write(fitting)


def _rows(curve: list[dict[str, float]]) -> list[dict[str, float]]:
    # The last epoch has every term; those that were not looked at lack the score.
    return [
        {"step": epoch, **{name: terms.get(name, math.nan) for name in curve[-1]}}
        for epoch, terms in enumerate(curve, start=1)
    ]
