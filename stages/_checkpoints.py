"""Checkpoints of a training that was killed, outside of what DVC deletes and caches."""

import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import pacmo_core
from pacmo_core.reaction.fit import Fit, Snapshot
from pacmo_core.store.weights import read_weights, write_weights

CHECKPOINTS = Path("checkpoints")
# What a training runs: an edit elsewhere does not cost a checkpoint.
CODE = ("interaction.py", "transform.py", "operators/*.py", "pacmo/*.py")


class Checkpoint:
    """The last checkpoint of one training, under a name made of all that the training rests on.

    Another configuration, other data or other code have another name, so that none of them goes
    on from here. In a group of processes all read and the first one writes.

    Parameters
    ----------
    stage : name of the stage
    facts : all that the training rests on besides the code, in JSON's terms
    """

    def __init__(self, stage: str, facts: Mapping[str, Any]) -> None:
        text = json.dumps([stage, facts, code_hash()], sort_keys=True)
        self.stage = stage
        name = hashlib.sha256(text.encode()).hexdigest()[:24]
        self.path = CHECKPOINTS / f"{stage}-{name}.safetensors"

    def resume(self, fit: Fit[Any]) -> None:
        """Let a fit go on from the checkpoint, if there is one."""
        if self.path.exists():
            facts, tensors = read_weights(self.path)
            fit.restore(Snapshot(tensors, facts))

    def write(self, fit: Fit[Any]) -> None:
        """Write where a fit stands."""
        snapshot = fit.snapshot()
        write_weights(self.path, snapshot.facts, snapshot.tensors)

    def remove(self) -> None:
        """Forget a training that ended well."""
        self.path.unlink(missing_ok=True)


def code_hash() -> str:
    """SHA-256 of the code that a training runs, in hexadecimal."""
    root = Path(pacmo_core.__path__[0])
    digest = hashlib.sha256()
    for path in _files(root, CODE):
        digest.update(f"{path.relative_to(root)}\0".encode() + path.read_bytes() + b"\0")
    return digest.hexdigest()


def _files(root: Path, patterns: Iterable[str]) -> list[Path]:
    return [path for pattern in patterns for path in sorted(root.glob(pattern))]
