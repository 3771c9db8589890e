"""Weights of networks in safetensors, with their configuration as JSON in the same file."""

import errno
import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file

from pacmo_core.data.limits import file_fault, printable
from pacmo_core.store.files import StoreError, atomic_file
from pacmo_core.store.tables import ClipRecord

MAX_WEIGHTS_BYTES = 1 << 30  # of a file of weights, or of a checkpoint

# Of safetensors and JSON on damaged files, and of torch on types of numbers that it does not have.
_FAULTS = (SafetensorError, KeyError, ValueError, AttributeError, RuntimeError, TypeError)


@dataclass(frozen=True)
class TrainedOn:
    """What a network was trained on, which its weights state as metadata.

    Parameters
    ----------
    datasets : their names, sorted
    clips : how many
    synthetic_clips : how many of them were generated, not recorded
    """

    datasets: tuple[str, ...]
    clips: int
    synthetic_clips: int

    @classmethod
    def of(cls, records: Iterable[ClipRecord]) -> "TrainedOn":
        """Summarise the records of training clips."""
        rows = list(records)
        datasets = tuple(sorted({row.dataset for row in rows}))
        return cls(datasets, len(rows), sum(row.synthetic for row in rows))

    def __add__(self, other: "TrainedOn") -> "TrainedOn":
        """Return what two trainings, one after the other, were on; a clip of both counts twice."""
        datasets = tuple(sorted({*self.datasets, *other.datasets}))
        synthetic = self.synthetic_clips + other.synthetic_clips
        return TrainedOn(datasets, self.clips + other.clips, synthetic)

    @property
    def is_synthetic(self) -> bool:
        """Whether no clip was recorded."""
        return 0 < self.clips == self.synthetic_clips

    def to_dict(self) -> dict[str, Any]:
        """Return the fields by name, which JSON can represent."""
        return asdict(self)

    def __str__(self) -> str:
        """Say it in words: ``400 clips of default, all synthetic``."""
        kinds = {0: "recorded", self.clips: "all synthetic"}
        kind = kinds.get(self.synthetic_clips, f"{self.synthetic_clips} of them synthetic")
        clips = "1 clip" if self.clips == 1 else f"{self.clips} clips"
        return f"{clips} of {', '.join(self.datasets) or 'no dataset'}, {kind}"


def write_weights(path: Path, config: dict[str, Any], state: dict[str, torch.Tensor]) -> None:
    """Write the configuration and the state of a network atomically."""
    tensors = {name: tensor.detach().cpu().contiguous() for name, tensor in state.items()}
    with atomic_file(path) as partial:
        try:
            save_file(tensors, partial, metadata={"config": json.dumps(config, sort_keys=True)})
        except SafetensorError as error:  # a full disk
            raise OSError(errno.EIO, str(error)) from error


def read_weights(path: Path) -> tuple[dict[str, Any], dict[str, torch.Tensor]]:
    """Read the configuration and the state of a network.

    Raises
    ------
    StoreError
        If the file is damaged, too large, or contains no configuration.
    """
    if fault := file_fault(path, MAX_WEIGHTS_BYTES):
        raise StoreError(f"{path}: {fault}")
    try:
        with safe_open(path, framework="pt") as file:
            config = json.loads((file.metadata() or {})["config"])
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except _FAULTS as error:
        raise StoreError(f"{path}: not a complete file of weights ({error})") from error
    if not isinstance(config, dict):
        kind = type(config).__name__
        raise StoreError(f"{path}: not a complete file of weights (its configuration is a {kind})")
    return config, tensors


def read_trained_on(path: Path) -> TrainedOn | None:
    """Read what a network was trained on; None where its weights do not state it.

    Raises
    ------
    StoreError
        If the file is damaged, or states it wrongly.
    """
    if fault := file_fault(path, MAX_WEIGHTS_BYTES):
        raise StoreError(f"{path}: {fault}")
    try:
        with safe_open(path, framework="pt") as file:
            config = json.loads((file.metadata() or {})["config"])
        facts = config.get("trained_on")
        return None if facts is None else _trained_on(facts)
    except _FAULTS as error:
        raise StoreError(f"{path}: not a complete file of weights ({error})") from error


def _trained_on(facts: dict[str, Any]) -> TrainedOn:
    datasets, clips, synthetic = facts["datasets"], facts["clips"], facts["synthetic_clips"]
    if not isinstance(datasets, list) or not all(isinstance(name, str) for name in datasets):
        raise ValueError("trained_on: wanted a list of names of datasets")
    if type(clips) is not int or type(synthetic) is not int or not 0 <= synthetic <= clips:
        raise ValueError("trained_on: wanted numbers of clips")
    return TrainedOn(tuple(printable(name)[:100] for name in datasets[:20]), clips, synthetic)
