"""What is trusted: the bytes that the stages made before one of them was flipped."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from flows.reproduce import reproduce
from flows.run import main
from pacmo_core.project.objects import (
    VERIFIED,
    cache_objects,
    corrupt_objects,
    object_hash,
)

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("prefect_server")]
FOLDER = """\
  folder:
    cmd: mkdir -p made && cp both.txt made/one && cp left.txt made/two
    deps: [both.txt, left.txt]
    outs: [made]
"""
MADE = ("raw.txt", "left.txt", "both.txt", "made/one")


@pytest.fixture(params=["hardlink", "symlink"])
def made(pipeline, request):
    """Run all stages, whose outputs are links to DVC's cache; return their content."""
    dvc = [sys.executable, "-m", "dvc"]
    subprocess.run([*dvc, "config", "cache.type", request.param], check=True)
    stage = Path("stage.py")
    stage.write_text(stage.read_text().replace("time.sleep(1)", ""))
    with Path("dvc.yaml").open("a") as file:
        file.write(FOLDER)
    Path("params.yaml").write_text("runs: {folds: [1], seeds: [1]}\n")
    reproduce([])
    return {name: Path(name).read_bytes() for name in MADE}


def flip(path: Path, *, keep_time: bool) -> None:
    """Flip a bit of a write-protected file, and set its time back or not."""
    facts = path.stat()
    path.chmod(0o644)
    content = bytearray(path.read_bytes())
    content[0] ^= 1
    with path.open("r+b") as file:
        file.write(content)
    path.chmod(0o444)
    if keep_time:
        os.utime(path, ns=(facts.st_atime_ns, facts.st_mtime_ns))


@pytest.mark.parametrize("keep_time", [False, True])
def test_a_flipped_bit_of_an_output_is_found_by_the_next_run_and_made_good(made, keep_time):
    for name in MADE:
        flip(Path(name), keep_time=keep_time)
        assert Path(name).read_bytes() != made[name]
        assert reproduce([])
        assert {name: Path(name).read_bytes() for name in MADE} == made
        assert corrupt_objects() == []
    assert reproduce([]) == []


def test_the_command_finds_it_before_it_says_that_nothing_is_stale(made, capsys, monkeypatch):
    asked = []
    monkeypatch.setattr("flows.run.run_flow", lambda *arguments: asked.append(arguments) or 0)
    assert main(["reproduce"]) == 0 and asked == []
    flip(Path("both.txt"), keep_time=True)
    assert main(["reproduce"]) == 0 and len(asked) == 1
    assert capsys.readouterr().out.count("nothing is stale") == 1


def test_what_was_hashed_is_hashed_again_only_if_it_has_changed(made, monkeypatch):
    hashed = []
    with monkeypatch.context() as patch:
        patch.setattr("pacmo_core.project.objects._md5", hashed.append)
        assert corrupt_objects(skip_verified=True) == [] and hashed == []
        Path("both.txt").chmod(0o644)
        assert len(corrupt_objects(skip_verified=True)) == len(hashed) == 1
    VERIFIED.write_text("{")
    assert corrupt_objects(skip_verified=True) == []
    assert set(json.loads(VERIFIED.read_text())) == {object_hash(p) for p in cache_objects()}
