"""What is trusted: the system's own limit of the size of a file, which acts as a full disk does."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.test_ingestion import PARAMS, bodies, write

ROOT = Path(__file__).parents[2]
WEIGHTS = """\
import torch
from pathlib import Path
from pacmo_core.store.weights import write_weights
from stages.common.params import run_stage
run_stage(lambda: write_weights(Path("w.safetensors"), {}, {"w": torch.zeros(100_000)}))
"""
COMMANDS = {
    "sequences/motions.parquet": ["-m", "stages.ingest", "raw", "sequences", "m.json"],
    "cache/": ["-m", "stages.ingest", "--cache=cache", "raw", "sequences", "m.json"],
    "w.safetensors": ["-c", WEIGHTS],
}


@pytest.mark.parametrize("name", COMMANDS)
def test_a_full_disk_is_one_line_that_names_the_file_and_leaves_none(tmp_path, name):
    (tmp_path / "params.yaml").write_text(PARAMS)
    (tmp_path / "raw").mkdir()
    for number in range(3):
        write(tmp_path / "raw", number, bodies(number, n_frames=60))
    before = sorted(path for path in tmp_path.rglob("*") if path.is_file())
    command = ["bash", "-c", 'ulimit -f 8; exec "$@"', "bash", sys.executable, *COMMANDS[name]]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert line.startswith(name) and "too large" in line
    assert sorted(path for path in tmp_path.rglob("*") if path.is_file()) == before
