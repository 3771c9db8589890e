"""Variations that were made before, under the hash of all that they rest on.

A folder a source, a file a batch. A file is written whole or not at all, so that a run that is
killed loses the batch in hand; each of its entries bears its own hash, so that a file that was
damaged since is found, and made again.
"""

import hashlib
import json
import logging
import shutil
from collections.abc import Mapping
from pathlib import Path

from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from pacmo_core.augmentation.solve import Made
from pacmo_core.data.interaction import Motion
from pacmo_core.store.atomic import whole_file

LOG = logging.getLogger(__name__)


class Kept:
    """What one maker made of any sources.

    Parameters
    ----------
    folder : of all makers
    maker : the hash of settings and code
    """

    def __init__(self, folder: Path, maker: str) -> None:
        self._folder, self._own = folder, folder / maker

    def find(self, source: str) -> dict[str, Path]:
        """Say in which file each variation of a source stands; damaged files are removed."""
        found: dict[str, Path] = {}
        for path in sorted((self._own / source).glob("*.safetensors")):
            try:
                found |= dict.fromkeys(_checked(path), path)
            except (SafetensorError, KeyError, TypeError, ValueError) as fault:
                LOG.warning("%s is damaged and will be made again (%s)", path, fault)
                path.unlink()
        return found

    def write(self, source: str, made: Mapping[str, Made]) -> dict[str, Path]:
        """Keep a batch; say in which file each of it stands."""
        if not made:
            return {}
        names = sorted(made)
        tensors = {name: made[name].motions for name in names}
        facts = {
            name: json.dumps({"sha256": _hash(tensors[name]), "figures": made[name].figures})
            for name in names
        }
        batch = hashlib.sha256("\0".join(names).encode()).hexdigest()[:32]
        path = self._own / source / f"{batch}.safetensors"
        with whole_file(path) as partial:
            save_file(tensors, partial, metadata=facts)
        return dict.fromkeys(names, path)

    def forget_others(self) -> None:
        """Remove what other code or settings made."""
        for other in self._folder.iterdir() if self._folder.is_dir() else ():
            if other != self._own and other.is_dir():
                shutil.rmtree(other)


def read_kept(path: Path, name: str) -> Made:
    """Read one variation of a file that ``Kept`` found or wrote."""
    with safe_open(path, framework="numpy") as file:
        figures = json.loads(file.metadata()[name])["figures"]
        return Made(file.get_tensor(name), figures)


def _checked(path: Path) -> list[str]:
    """List a file's entries, each held against its hash.

    Raises
    ------
    SafetensorError
        If the file is cut short.
    ValueError
        If an entry is not what was written.
    """
    with safe_open(path, framework="numpy") as file:
        facts = file.metadata()
        names = list(file.keys())
        for name in names:
            if _hash(file.get_tensor(name)) != json.loads(facts[name])["sha256"]:
                raise ValueError(f"{name} is not what was written")
    return names


def _hash(motions: Motion) -> str:
    return hashlib.sha256(motions.tobytes()).hexdigest()
