"""What is trusted: the list as DVC 3 writes it, and which processes live."""

import json
import os
import subprocess
import sys

from pacmo_core.project.lock import is_alive, remove_dead_dvc_locks, remove_partial_files


def dead_process():
    process = subprocess.Popen([sys.executable, "-c", ""])
    while is_alive(process.pid):
        pass
    return process  # not waited for: its number is taken


def test_the_dead_are_taken_off_the_list_and_the_living_stay(tmp_path):
    process = dead_process()
    dead, alive = ({"pid": pid, "cmd": "dvc"} for pid in (process.pid, os.getpid()))
    path = tmp_path / "rwlock"
    path.write_text(
        json.dumps({"write": {"a": dead, "b": alive}, "read": {"c": [dead, alive], "d": []}})
    )
    assert remove_dead_dvc_locks(path) == [process.pid]
    process.wait()
    assert json.loads(path.read_text()) == {"write": {"b": alive}, "read": {"c": [alive], "d": []}}
    assert remove_dead_dvc_locks(path) == []


def test_a_list_that_was_cut_short_is_removed(tmp_path):
    path = tmp_path / "rwlock"
    path.write_text('{"write": {"a": {"pi')
    assert remove_dead_dvc_locks(path) == [] and not path.exists()
    assert remove_dead_dvc_locks(path) == []


def test_half_written_files_of_the_dead_are_litter_and_nothing_else_is(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    process = dead_process()
    for place in ("data/clips", "reports"):
        (tmp_path / place).mkdir(parents=True)
    litter = tmp_path / f"data/clips/.motions.parquet.{process.pid}"
    mine = tmp_path / f"reports/.page.html.{os.getpid()}"
    others = [tmp_path / "reports/.gitignore", tmp_path / "data/clips/motions.parquet"]
    for path in (litter, mine, *others):
        path.write_text("x")
    assert [path.resolve() for path in remove_partial_files()] == [litter]
    process.wait()
    assert all(path.exists() for path in (mine, *others))
