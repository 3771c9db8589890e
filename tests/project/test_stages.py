"""What is trusted: a diamond of four stages written out in conftest.py."""

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import pytest

from pacmo_core.project.stages import (
    STATUS,
    StageStatus,
    _compute_status,
    read_status,
    upstream_and_stale,
    upstream_stages,
)

ROOT = Path(__file__).parents[2]


def test_stages_come_after_what_they_rest_on(pipeline):
    below = upstream_stages([])
    assert next(iter(below)) == "raw" and [*below][-1] == "both"
    assert below["left"] == ["raw"]
    assert sorted(below["both"]) == ["left", "right"]


def test_only_what_a_target_rests_on_is_listed(pipeline):
    assert list(upstream_stages(["left"])) == ["raw", "left"]


def test_an_unknown_target_is_named_with_what_there_is(pipeline):
    with pytest.raises(ValueError, match=r"no stage lefty; it has both, left, raw, right"):
        upstream_stages(["lefty"])


def test_nothing_is_stale_after_a_reproduction_and_all_below_an_edit_is(pipeline):
    assert upstream_and_stale([])[1] == {"raw", "left", "right", "both"}
    subprocess.run([sys.executable, "-m", "dvc", "repro", "-q"], check=True)
    assert upstream_and_stale([])[1] == set()
    (pipeline / "left.txt").unlink()
    assert upstream_and_stale([])[1] == {"left", "both"}


def test_all_below_an_edit_is_stale_before_anything_has_run(pipeline):
    subprocess.run([sys.executable, "-m", "dvc", "repro", "-q"], check=True)
    (pipeline / "params.yaml").write_text("first: 2\n")
    assert upstream_and_stale([])[1] == {"raw", "left", "right", "both"}


def reproduce():
    subprocess.run([sys.executable, "-m", "dvc", "repro", "-q"], check=True)


def remove_cached(path):
    digest = hashlib.md5(path.read_bytes(), usedforsecurity=False).hexdigest()
    (Path(".dvc/cache/files/md5") / digest[:2] / digest[2:]).unlink()


EDITS = {
    "nothing": lambda root: None,
    "dependency": lambda root: (root / "stage.py").write_text("# edited"),
    "same content": lambda root: (root / "params.yaml").write_text("first: 1\n"),
    "output gone": lambda root: (root / "left.txt").unlink(),
    "output edited": lambda root: (root / "left.txt").write_text("edited"),
    "cached copy gone": lambda root: remove_cached(root / "both.txt"),
    "lock gone": lambda root: (root / "dvc.lock").unlink(),
    "file in a folder": lambda root: (root / "folder" / "new").write_text("new"),
    "bytecode in a folder": lambda root: (root / "folder" / "__pycache__").mkdir(),
}


@pytest.mark.parametrize("edit", EDITS)
def test_the_stored_status_is_the_one_that_dvc_would_give_after_any_edit(pipeline, edit):
    (pipeline / "folder").mkdir()
    (pipeline / "folder" / "old").write_text("old")
    dvc_yaml = (pipeline / "dvc.yaml").read_text()
    (pipeline / "dvc.yaml").write_text(dvc_yaml.replace("[stage.py, raw", "[folder, stage.py, raw"))
    (pipeline / ".dvcignore").write_text("__pycache__/\nhistory/\n")
    reproduce()
    assert read_status() == read_status() == StageStatus(4, {})
    EDITS[edit](pipeline)
    seen = read_status()
    assert seen == _compute_status()
    unchanged = ("nothing", "same content", "bytecode in a folder")
    assert bool(seen.reasons) == (edit not in unchanged)


def test_an_unchanged_workspace_is_recognised_without_dvc(pipeline):
    reproduce()
    read_status()
    script = (
        "import sys; from pacmo_core.project.stages import read_status; read_status(); "
        "assert not {'dvc', 'torch', 'prefect'} & sys.modules.keys()"
    )
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    subprocess.run([sys.executable, "-c", script], env=environment, check=True)
    STATUS.write_text("{")
    assert read_status() == StageStatus(4, {})
