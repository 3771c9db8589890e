"""Checkpoints, from which an interrupted training resumes, and hashes of its code and data."""

import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

import pacmo_core
from pacmo_core.data.interaction import Interaction
from pacmo_core.store.weights import read_weights, write_weights
from pacmo_core.training.loop import Snapshot, TrainingLoop

CHECKPOINTS = Path("checkpoints")
# Packages that every training uses: after an edit of these or of the model's no checkpoint is used.
SHARED_PACKAGES = ("data", "operators", "training")


class Checkpoint:
    """The last checkpoint of one training, in a file named by a hash of all it depends on.

    A training with other settings, data or code has another name and does not resume from it. In a
    process group all processes read and the first one writes.

    Parameters
    ----------
    stage : name of the stage
    facts : all that the training depends on besides the code, in JSON's terms
    package : of ``pacmo_core``, in which the model is
    """

    def __init__(self, stage: str, facts: Mapping[str, Any], package: str) -> None:
        text = json.dumps([stage, facts, code_hash([*SHARED_PACKAGES, package])], sort_keys=True)
        self.stage = stage
        name = hashlib.sha256(text.encode()).hexdigest()[:24]
        self.path = CHECKPOINTS / f"{stage}-{name}.safetensors"

    def resume(self, loop: TrainingLoop[Any]) -> None:
        """Restore a loop from the checkpoint, if there is one."""
        if self.path.exists():
            facts, tensors = read_weights(self.path)
            loop.restore(Snapshot(tensors, facts))

    def write(self, loop: TrainingLoop[Any]) -> None:
        """Write a snapshot of a loop."""
        snapshot = loop.snapshot()
        write_weights(self.path, snapshot.facts, snapshot.tensors)

    def remove(self) -> None:
        """Delete the checkpoint of a training that has ended."""
        self.path.unlink(missing_ok=True)


def code_hash(packages: Iterable[str]) -> str:
    """SHA-256 of the code of packages of ``pacmo_core``, in hexadecimal."""
    root = Path(pacmo_core.__path__[0])
    digest = hashlib.sha256()
    for package in packages:
        for path in sorted((root / package).rglob("*.py")):
            digest.update(f"{path.relative_to(root)}\0".encode() + path.read_bytes() + b"\0")
    return digest.hexdigest()


def data_hash(clips: Iterable[Interaction]) -> str:
    """SHA-256 of clips in their order, in hexadecimal: skeletons, times and motions."""
    digest = hashlib.sha256()
    for clip in clips:
        digest.update(f"{clip.skeleton!r} {clip.person_a.shape}".encode())
        for values in (clip.times, clip.person_a, clip.person_b):
            digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()
