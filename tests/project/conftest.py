"""A DVC project of four stages in a diamond."""

import subprocess
import sys
from pathlib import Path

import pytest

PIPELINE = """\
stages:
  raw:
    cmd: cp params.yaml raw.txt
    deps: [params.yaml]
    outs: [raw.txt]
  left:
    cmd: {python} stage.py raw.txt left.txt
    deps: [stage.py, raw.txt]
    outs: [left.txt]
  right:
    cmd: {python} stage.py raw.txt right.txt
    deps: [stage.py, raw.txt]
    outs: [right.txt]
  both:
    cmd: cat left.txt right.txt > both.txt
    deps: [left.txt, right.txt]
    outs: [both.txt]
"""
STAGE = """\
import sys, time
from pathlib import Path
start = time.monotonic()
time.sleep(1)
text = Path(sys.argv[1]).read_text()
if "break" in text:
    sys.exit("broken on purpose")
Path(sys.argv[2]).write_text(f"{text.strip()} {sys.argv[2]}\\n")
with Path("spans.log").open("a") as log:
    log.write(f"{start} {time.monotonic()}\\n")
"""


@pytest.fixture
def pipeline(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Make a DVC project of four stages in a diamond, and stand in it."""
    (tmp_path / "dvc.yaml").write_text(PIPELINE.format(python=sys.executable))
    (tmp_path / "stage.py").write_text(STAGE)
    (tmp_path / "params.yaml").write_text("first: 1\n")
    run = [sys.executable, "-m", "dvc"]
    subprocess.run([*run, "init", "-q", "--no-scm"], cwd=tmp_path, check=True)
    subprocess.run([*run, "config", "core.analytics", "false"], cwd=tmp_path, check=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path
