"""A trained skeleton prior from its file."""

from dataclasses import fields
from pathlib import Path

from pacmo_core.skeleton_prior.model import PriorConfig, SkeletonPrior
from pacmo_core.skeleton_prior.training import from_state
from pacmo_core.store.files import StoreError
from pacmo_core.store.weights import read_weights

KIND = "skeleton_prior"


def load_prior(path: Path) -> SkeletonPrior:
    """Build a model that varies from its ``weights.safetensors``; nothing is unpickled.

    Raises
    ------
    OSError
        If there is no such file.
    StoreError
        If the file is not whole, or holds another kind of model, or one of another version.
    """
    path.stat()  # an error of the system names the file, safetensors' does not
    config, state = read_weights(path)
    if config.get("kind") != KIND:
        raise StoreError(f"{path}: wanted a model of kind {KIND}; got {config.get('kind')}")
    wanted = {field.name for field in fields(PriorConfig)}
    odd = sorted(wanted ^ config["model"].keys())
    if odd:
        raise StoreError(
            f"{path}: a model of another version, to be trained anew; differs in {odd}"
        )
    return from_state(config["model"], state)
