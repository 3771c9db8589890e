"""Train a model: checkpoints, progress and a live curve, then weights and the curve."""

import math
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Protocol

import torch
import torch.distributed as dist
from dvclive.live import Live
from rich.console import Console
from rich.progress import track

from pacmo_core.data.interaction import Interaction
from pacmo_core.models import Model
from pacmo_core.store.weights import TrainedOn, write_weights
from pacmo_core.training.checkpoints import Checkpoint, data_hash
from pacmo_core.training.devices import is_main_process, training_device
from pacmo_core.training.loop import TrainingData, TrainingLoop
from pacmo_core.training.state import model_config, model_state
from stages.common.files import WEIGHTS, write_curve
from stages.common.params import ParamsError
from stages.common.progress import Progress

LIVE_FOLDER = Path("live")


class TrainingParams(Protocol):
    """The parameters that every training section of ``params.yaml`` has."""

    @property
    def threads(self) -> int:
        """Number of threads of torch."""

    @property
    def device(self) -> str:
        """Device: cpu, cuda or auto."""

    @property
    def checkpoint_every(self) -> int:
        """Epochs between checkpoints."""


@dataclass(frozen=True)
class Task:
    """One model's training.

    Parameters
    ----------
    model : row of the registry
    params : the model's section of ``params.yaml``
    data : training and validation clips; their hashes are metadata of the weights
    trained_on : the datasets of the training clips, metadata of the weights too
    build : from a device to a training loop
    """

    model: Model
    params: TrainingParams
    data: TrainingData[Interaction]
    trained_on: TrainedOn
    build: Callable[[str], TrainingLoop[Any]]


def train(task: Task, model: Path, curve: Path) -> None:
    """Train, from the last checkpoint if there is one; write weights into ``model``, and the curve.

    On a CPU a training that was killed and started again writes the same bytes as an
    uninterrupted one.

    Raises
    ------
    ParamsError
        If there is no such device, or no model of these settings can be made.
    """
    params = task.params
    with ExitStack() as stack:
        with settings_at_fault(task.model.section):
            device = stack.enter_context(
                training_device(
                    params.device, threads=params.threads, multiprocess=task.model.multiprocess
                )
            )
            loop = task.build(device)
        metadata = _metadata(task, loop)
        stage = f"train_{task.model.name}"
        checkpoint = Checkpoint(stage, {**metadata, **_environment(device)}, task.model.package)
        checkpoint.resume(loop)
        if is_main_process():
            _train_epochs(loop, checkpoint, params.checkpoint_every, model)
            write_curve(curve, _rows(loop.curve))
            selection = {"selection": loop.selection()}
            write_weights(model / WEIGHTS, metadata | selection, model_state(loop.model))
            checkpoint.remove()
        else:
            loop.finish()


@contextmanager
def settings_at_fault(section: str) -> Iterator[None]:
    """Report what a device or a network refuses as an error of a section of ``params.yaml``."""
    try:
        yield
    except (ValueError, ArithmeticError, RuntimeError, MemoryError) as fault:
        reason = " ".join(str(fault).split()) or type(fault).__name__
        raise ParamsError(
            section, f"no model can be made of the captures with this: {reason}"
        ) from fault


def _metadata(task: Task, loop: TrainingLoop[Any]) -> dict[str, Any]:
    return {
        "model": task.model.name,
        "config": model_config(loop.model),
        "settings": asdict(task.params),  # type: ignore[call-overload]  # a dataclass, see Params
        "data": {
            "train": data_hash(task.data.train),
            "validation": data_hash(task.data.validation),
        },
        "trained_on": task.trained_on.to_dict(),
        # Without the name of the build, so that equal results have equal bytes.
        "torch": torch.__version__.partition("+")[0],
    }


def _environment(device: str) -> dict[str, Any]:
    n_processes = dist.get_world_size() if dist.is_initialized() else 1
    return {"device": device.partition(":")[0], "processes": n_processes}


def _train_epochs(loop: TrainingLoop[Any], checkpoint: Checkpoint, every: int, model: Path) -> None:
    done = len(loop.curve)
    progress = Progress(loop.n_epochs, "epochs")
    console = Console(stderr=True)
    with live_curve(model, loop.curve) as live:
        epochs = track(loop, checkpoint.stage, loop.n_epochs, completed=done, console=console)
        for epoch, terms in enumerate(epochs, start=done + 1):
            live.add(epoch, terms)
            progress.update(epoch)
            if epoch % every == 0:
                checkpoint.write(loop)


def _rows(curve: list[dict[str, float]]) -> list[dict[str, float]]:
    # The last epoch has every term; those without validation lack the score.
    return [
        {"step": epoch, **{name: terms.get(name, math.nan) for name in curve[-1]}}
        for epoch, terms in enumerate(curve, start=1)
    ]


class LiveCurve:
    """A training curve that ``dvc plots show`` and editors plot during the training."""

    def __init__(self, live: Live) -> None:
        self._live = live

    def add(self, epoch: int, terms: Mapping[str, float]) -> None:
        """Add one epoch, from 1."""
        self._live.step = epoch
        for name, value in terms.items():
            self._live.log_metric(name, value, timestamp=False)
        self._live.make_summary()  # type: ignore[no-untyped-call]  # dvclive has no types here


@contextmanager
def live_curve(folder: Path, epochs: Iterable[Mapping[str, float]]) -> Iterator[LiveCurve]:
    """Create ``live/FOLDER`` with the epochs of the checkpoint."""
    # Nothing is uploaded unless the user has set this variable.
    os.environ.setdefault("DVC_STUDIO_OFFLINE", "true")
    path = str(LIVE_FOLDER / folder.relative_to(folder.anchor))
    with Live(path, save_dvc_exp=False, dvcyaml=None, monitor_system=False) as live:
        curve = LiveCurve(live)
        for epoch, terms in enumerate(epochs, start=1):
            curve.add(epoch, terms)
        yield curve
