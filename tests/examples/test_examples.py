"""What is trusted: that a script ends without an error and writes what it says."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
# Arguments that make a script quick, and a file that it writes.
SCRIPTS = {
    "1_load_and_view.py": (["."], "clips.html"),
    "2_train_and_react.py": [[".", "4"], "reactions.html"],
    "3_retarget.py": [["."], "retargeted.html"],
    "4_evaluate.py": [["2"], None],
    "5_walkthrough.py": [[".", "2"], "library.png"],
}


def test_all_examples_are_here_and_short():
    files = sorted((ROOT / "examples").glob("*.py"))
    assert [file.name for file in files] == sorted(SCRIPTS)
    assert max(len(file.read_text().splitlines()) for file in files) <= 30


@pytest.mark.slow
@pytest.mark.parametrize("name", SCRIPTS)
def test_an_example_runs(name, tmp_path):
    arguments, written = SCRIPTS[name]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    command = [sys.executable, str(ROOT / "examples" / name), *arguments]
    ended = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert ended.returncode == 0, ended.stderr
    assert written is None or (tmp_path / written).stat().st_size > 10_000
