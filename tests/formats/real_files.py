"""Real captures, where a machine has them: they are not the repository's to hand on."""

import os
from pathlib import Path

import pytest


def real_folder(name: str) -> Path:
    """Name a folder of real captures, or skip the test with the reason."""
    folder = Path(os.environ.get("PACMO_REAL_DATA", "../shared/data")) / name
    if not folder.is_dir():
        pytest.skip(f"no real captures in {folder}; PACMO_REAL_DATA may name another place")
    return folder
