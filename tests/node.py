"""Node with the packages of npm/: what the tests judge exports by that is not ours."""

import json
import shutil
import subprocess
from functools import cache
from pathlib import Path
from typing import Any

import pytest

FOLDER = Path(__file__).parents[1] / "npm"
PATIENCE_S = 180


@cache
def _missing() -> str:
    """Install the packages of the lock once; say what is missing, if anything."""
    node, npm = shutil.which("node"), shutil.which("npm")
    if not node or not npm:
        return "no node and npm on this machine"
    if (FOLDER / "node_modules" / "three").is_dir():
        return ""
    command = [npm, "ci", "--ignore-scripts", "--prefix", str(FOLDER)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S)
    return f"npm ci failed: {done.stderr.strip()[-200:]}" if done.returncode else ""


def node(script: str, *words: object) -> str:
    """Run a script of npm/; skip the test where there is no node, or no registry."""
    if reason := _missing():
        pytest.skip(reason)
    command = ["node", script, *map(str, words)]
    done = subprocess.run(command, cwd=FOLDER, capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 0, done.stderr
    return done.stdout


def node_json(script: str, *words: object) -> Any:
    """Read what such a script prints."""
    return json.loads(node(script, *words))
