"""Readings that were made before, under the hash of all that they rest on: content, settings, code.

A file a batch, written whole or not at all. Each entry bears the hash of its arrays, so that one
that was damaged since is read anew. What is kept is no output: with it or without it a set is
ingested to the same bytes.
"""

import hashlib
import json
import logging
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import cache
from importlib.metadata import version
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.formats.base import RawSequence
from pacmo_core.store.atomic import whole_file
from pacmo_core.store.clips import ClipFacts, QuarantineFacts

LOG = logging.getLogger(__name__)
Usable = tuple[ClipFacts, Interaction]
Outcome = Usable | QuarantineFacts

# What a reading runs: an edit elsewhere does not cost what is kept.
CODE = (
    *("formats/*.py", "ingestion.py", "readings.py", "interaction.py", "skeleton.py"),
    *("quality.py", "contact.py", "store/clips.py"),
)
PACKAGES = ("numpy", "scipy")
ARRAYS = ("times", "person_a", "person_b")


class Readings:
    """What one recipe made of any files.

    Parameters
    ----------
    folder : of all recipes
    recipe : all that a reading rests on beside its files, in words; the code is added here
    """

    def __init__(self, folder: Path, recipe: str) -> None:
        self._own = folder / hashlib.sha256(f"{recipe}\0{code_key()}".encode()).hexdigest()[:32]
        self._places: dict[str, Path] = {}
        for path in sorted(self._own.glob("*.safetensors")):
            self._places |= dict.fromkeys(_keys(path), path)

    def get(self, keys: Sequence[str]) -> dict[str, Outcome]:
        """Give what is kept under these keys, whole; what is damaged is left out."""
        wanted: dict[Path, list[str]] = {}
        for key in keys:
            if key in self._places:
                wanted.setdefault(self._places[key], []).append(key)
        found: dict[str, Outcome] = {}
        for path, names in wanted.items():
            found |= _read(path, names)
        return found

    def keep(self, made: Mapping[str, Outcome]) -> None:
        """Keep a batch."""
        if not made:
            return
        tensors: dict[str, NDArray[Any]] = {}
        facts = {}
        for key, outcome in made.items():
            row = outcome if isinstance(outcome, QuarantineFacts) else outcome[0]
            entry: dict[str, Any] = {"row": asdict(row), "arrays": ""}
            if not isinstance(outcome, QuarantineFacts):
                arrays = {name: getattr(outcome[1], name) for name in ARRAYS}
                entry["arrays"] = _hash(arrays)
                entry["skeleton"] = asdict(outcome[1].skeleton)
                tensors |= {f"{key}/{name}": array for name, array in arrays.items()}
            facts[key] = json.dumps(entry)
        batch = hashlib.sha256("\0".join(sorted(made)).encode()).hexdigest()[:32]
        path = self._own / f"{batch}.safetensors"
        with whole_file(path) as partial:
            save_file(tensors, partial, metadata=facts)
        self._places |= dict.fromkeys(made, path)


def reading_key(sequence: RawSequence, digest: str) -> str:
    """Hash one sequence: its labels, where its files are, and what is in them."""
    facts = {**asdict(sequence), "files": [file.as_posix() for file in sequence.files]}
    return hashlib.sha256(f"{json.dumps(facts)}\0{digest}".encode()).hexdigest()[:32]


@cache
def code_key() -> str:
    """Hash the code that reads, as this process has loaded it, and the versions it runs on."""
    digest = hashlib.sha256()
    for package in PACKAGES:
        digest.update(f"{package} {version(package)}\0".encode())
    root = Path(__file__).parent
    for path in chain.from_iterable(sorted(root.glob(pattern)) for pattern in CODE):
        digest.update(f"{path.relative_to(root)}\0".encode() + path.read_bytes() + b"\0")
    return digest.hexdigest()


def _keys(path: Path) -> list[str]:
    try:
        with safe_open(path, framework="numpy") as file:
            return list(file.metadata() or {})
    except SafetensorError as fault:
        LOG.warning("%s is damaged; what it held is read anew (%s)", path, fault)
        path.unlink()
        return []


def _read(path: Path, keys: list[str]) -> dict[str, Outcome]:
    found: dict[str, Outcome] = {}
    with safe_open(path, framework="numpy") as file:
        facts = file.metadata()
        for key in keys:
            entry = json.loads(facts[key])
            if not entry["arrays"]:
                found[key] = QuarantineFacts(**entry["row"])
                continue
            arrays = {name: file.get_tensor(f"{key}/{name}") for name in ARRAYS}
            if _hash(arrays) != entry["arrays"]:
                LOG.warning("%s: %s is damaged; it is read anew", path, key)
                continue
            found[key] = ClipFacts(**entry["row"]), Interaction(_body(entry), **arrays)
    return found


def _body(entry: dict[str, Any]) -> Skeleton:
    facts = entry["skeleton"]
    return Skeleton(
        name=facts["name"],
        joints=tuple(facts["joints"]),
        parents=tuple(facts["parents"]),
        left_right=tuple((left, right) for left, right in facts["left_right"]),
    )


def _hash(arrays: Mapping[str, NDArray[Any]]) -> str:
    digest = hashlib.sha256()
    for name in ARRAYS:
        digest.update(np.ascontiguousarray(arrays[name]).tobytes())
    return digest.hexdigest()
