"""What is trusted: a diamond of four stages written out in conftest.py."""

import subprocess
import sys

import pytest

from pacmo_core.project.stages import stale_stages, upstream_stages


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
    assert stale_stages() == {"raw", "left", "right", "both"}
    subprocess.run([sys.executable, "-m", "dvc", "repro", "-q"], check=True)
    assert stale_stages() == set()
    (pipeline / "left.txt").unlink()
    assert stale_stages() == {"left", "both"}


def test_all_below_an_edit_is_stale_before_anything_has_run(pipeline):
    subprocess.run([sys.executable, "-m", "dvc", "repro", "-q"], check=True)
    (pipeline / "params.yaml").write_text("first: 2\n")
    assert stale_stages() == {"raw", "left", "right", "both"}
