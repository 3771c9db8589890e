"""Reference: captures and models that the test wrote, and the files that nightlies leave."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pyarrow.parquet as pq
import pytest

from flows.nightly import retrain
from flows.prune import prune
from pacmo_core.project.objects import corrupt_objects
from pacmo_core.project.records import RunRecord, read_runs
from pacmo_core.project.workspace import RUNS, CommandError
from pacmo_core.promotion import read_decisions
from tests.flows.projects import (
    drop,
    environment,
    make_project,
    run_flow,
    run_nightly,
    set_params,
    start_nightly,
)
from tests.waiting import wait_until

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("prefect_server")]
WAIT = "\n    while not Path('go').exists(): time.sleep(0.05)"
CURRENT = Path("promoted/current/models/1/pacmo/1/weights.safetensors")


@pytest.fixture
def project(tmp_path, monkeypatch):
    make_project(tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def prune_run() -> RunRecord:
    prune()
    return read_runs(RUNS)[-1]


def lab() -> list[str]:
    return sorted(path.parent.name for path in Path("data/captures/lab").rglob("skeleton_pos.txt"))


def inbox() -> list[Path]:
    return [path for path in Path("data/inbox").rglob("*") if path.is_file()]


def test_ten_captures_three_of_them_corrupt_lead_to_a_promotion_and_a_worse_model_is_rejected(
    project,
):
    drop(project, range(10), spoilt=(2, 5, 8))
    first = run_nightly()
    assert (first.outcome, first.facts["verdict"]) == ("done", "promoted")
    assert len(lab()) == 7 and inbox() == []
    assert sorted(first.facts["quarantined"]) == [f"s01s02/01/{take:03d}" for take in (2, 5, 8)]
    assert all("wanted 91 fields" in reason for reason in first.facts["quarantined"].values())
    aside = list(Path("data/quarantine").rglob("skeleton_pos.txt"))
    assert len(aside) == 3 and len(list(Path("data/quarantine").rglob("reason.json"))) == 3
    good = CURRENT.read_bytes()

    set_params(project, f2id=0.7)
    second = run_nightly()
    assert (second.outcome, second.facts["verdict"]) == ("rejected", "rejected")
    assert "F²ID rose to 0.7; current 0.5 (0.4 to 0.6)" in second.reason
    assert CURRENT.read_bytes() == good


def test_a_nightly_with_nothing_new_runs_no_stage(project):
    drop(project, range(2))
    assert set(run_nightly().facts["stages"]) == {"split", "train_pacmo", "report"}
    again = run_nightly()
    assert (again.facts["stages"], again.facts["verdict"]) == ([], "unchanged")


def test_a_capture_with_existing_content_or_an_existing_name_is_quarantined(project):
    drop(project, range(2))
    run_nightly()
    drop(project, range(3))
    changed = Path("data/inbox/s01s02/01/001/skeleton_pos.txt")
    changed.write_text(changed.read_text().replace("1,0.", "1,-0.", 1))
    run = run_nightly()
    assert run.facts["accepted"] == ["s01s02/01/000", "s01s02/01/002"]  # 000 is the very same file
    assert "exists, with other content" in run.facts["quarantined"]["s01s02/01/001"]
    assert lab() == ["000", "001", "002"]


def test_training_waits_for_enough_new_captures(project):
    drop(project, range(2))
    assert run_nightly().facts["trained"]
    set_params(project, min_new_captures=2)
    drop(project, range(2, 3))
    waits = run_nightly()
    assert not waits.facts["trained"] and waits.facts["stages"] == ["split"]
    drop(project, range(3, 4))
    assert run_nightly().facts["trained"]


def test_prune_keeps_what_dvc_lock_and_the_promoted_models_name(project):
    drop(project, range(1))
    for f2id in (0.5, 0.4, 0.3):
        set_params(project, f2id=f2id)
        run_nightly()
    before = len(list(Path(".dvc/cache/files/md5").rglob("*")))
    run = prune_run()
    assert run.facts["objects"] > 0 and run.facts["promoted"] == [1, 2]
    assert len(list(Path(".dvc/cache/files/md5").rglob("*"))) < before
    assert [p.name for p in sorted(Path("promoted").glob("0*"))] == ["000003"]
    assert len(read_runs(Path("history/runs"))) <= 2 + 1
    assert run_nightly().facts["stages"] == []
    assert len(read_decisions(Path("history/decisions"))[0]) == 4


def test_a_corrupt_cache_object_is_detected_and_made_again(project):
    drop(project, range(1))
    run_nightly()
    good = Path("sides.txt").read_bytes()
    _corrupt(Path("sides.txt"))
    assert len(corrupt_objects()) == 1
    run = run_nightly()
    assert len(run.facts["corrupt_objects"]) == 1 and "split" in run.facts["stages"]
    assert Path("sides.txt").read_bytes() == good and corrupt_objects() == []


def test_broken_tables_are_made_again(project):
    drop(project, range(1))
    run_nightly()
    table, output = Path("history/decisions/decisions.parquet"), Path("sides.txt")
    good = output.read_bytes()
    for file in (table, output):
        file.unlink()  # not the cache's object, of which this may be a link
        file.write_bytes(b"PAR1 and nothing else")
    run = run_nightly()
    assert output.read_bytes() == good and "split" in run.facts["stages"]
    assert pq.read_table(table).num_rows == len(read_decisions(Path("history/decisions"))[0]) == 2


def test_of_two_flows_at_once_the_second_is_refused(project):
    drop(project, range(1))
    slow = Path("make.py").read_text().replace("import json, sys", "import json, sys, time")
    Path("make.py").write_text(slow.replace('== "split":', '== "split":' + WAIT))
    first = start_nightly()
    wait_until(lambda: "running" in [run.outcome for run in read_runs(Path("history/runs"))])
    second = run_flow(project, "nightly")
    assert second.returncode == 4 and '"job": "nightly"' in second.stderr
    Path("go").touch()
    assert first.wait() == 0
    assert [run.outcome for run in read_runs(Path("history/runs"))] == ["done"]


def test_after_a_kill_in_a_stage_no_process_of_it_is_left_and_the_next_nightly_succeeds(project):
    drop(project, range(1))
    whole = Path("make.py").read_text()
    slow = whole.replace("import json, sys", "import json, sys, time")
    slow = slow.replace('== "split":', '== "split":\n    time.sleep(60)')
    Path("make.py").write_text(slow)
    first = start_nightly()
    wait_until(lambda: _running("make.py split", project))
    first.send_signal(signal.SIGKILL)
    first.wait()
    assert _running("make.py split", project)  # DVC and the stage outlive their flow
    Path("make.py").write_text(whole)
    run = run_nightly()
    assert not _running("make.py split", project)
    assert run.facts["verdict"] == "promoted" and lab() == ["000"]
    assert [r.outcome for r in read_runs(Path("history/runs"))] == ["killed", "done"]


def test_a_stage_that_takes_too_long_is_ended_with_all_it_started(project):
    drop(project, range(1))
    slow = Path("make.py").read_text().replace("import json, sys", "import json, sys, time")
    Path("make.py").write_text(slow.replace('== "split":', '== "split":\n    time.sleep(60)'))
    text = (
        Path("params.yaml").read_text().replace("max_stage_hours: 0.1", "max_stage_hours: 0.0015")
    )
    Path("params.yaml").write_text(text)
    done = run_flow(project, "nightly")
    assert done.returncode == 1 and "split: stopped after its limit of 5 s" in done.stderr
    assert "Running stage" in Path("history/stages/split.log").read_text()
    assert not _running("make.py split", project)


def test_a_nightly_does_not_start_on_a_disk_that_is_nearly_full(project):
    drop(project, range(1))
    text = Path("params.yaml").read_text()
    Path("params.yaml").write_text(text.replace("min_free_gb: 0.0", "min_free_gb: 1e9"))
    done = run_flow(project, "nightly")
    assert done.returncode == 1 and "GB are free" in done.stderr
    assert lab() == [] and len(inbox()) == 1


@pytest.mark.parametrize("kilobytes", [1, 4, 40])
def test_a_full_disk_fails_the_nightly_and_the_next_one_succeeds(project, kilobytes):
    drop(project, range(3))
    limited = f"ulimit -f {kilobytes}; exec {sys.executable} -m flows.run nightly"
    full = subprocess.run(
        ["bash", "-c", limited], env=environment(), capture_output=True, text=True, check=False
    )
    assert full.returncode == 1, full.stderr
    done = run_flow(project, "nightly")
    assert done.returncode == 0, done.stderr
    assert lab() == ["000", "001", "002"] and inbox() == []
    assert read_runs(Path("history/runs"))[-1].facts["verdict"] == "promoted"
    assert corrupt_objects() == []


def test_a_nightly_whose_model_is_rejected_has_its_own_exit_code(project):
    drop(project, range(1))
    set_params(project, f2id=1.2)
    done = run_flow(project, "nightly")
    assert done.returncode == 3, done.stderr
    log = [json.loads(line) for line in Path("history/log.jsonl").read_text().splitlines()]
    assert log[-1]["verdict"] == "rejected" and log[-1]["level"] == "info"


def test_retraining_to_the_same_model_changes_nothing(project):
    drop(project, range(1))
    run_nightly()
    retrain(["pacmo"])
    run = read_runs(RUNS)[-1]
    assert run.facts["stages"] == ["train_pacmo"]
    assert run.facts["verdict"] == "unchanged"
    with pytest.raises(CommandError, match="no stage trains gru; there are pacmo"):
        retrain(["gru"])


def test_a_forced_stage_runs_again_and_an_unknown_one_is_named(project):
    drop(project, range(1))
    run_nightly()
    ran = Path("history/stages/split.log")
    assert run_flow(project, "reproduce", "split").returncode == 0
    assert run_flow(project, "reproduce", "--force", "split").returncode == 0
    assert "Running stage" in ran.read_text()
    done = run_flow(project, "reproduce", "splat")
    assert done.returncode == 1
    assert done.stderr.endswith("no stage splat; it has report, split, train_pacmo\n")


def test_outputs_are_pushed_where_there_is_a_remote(project, tmp_path_factory):
    remote = tmp_path_factory.mktemp("remote")
    dvc = [sys.executable, "-m", "dvc", "remote", "add", "-q", "-d", "store", str(remote)]
    subprocess.run(dvc, check=True)
    drop(project, range(1))
    assert run_nightly().facts["pushed"]
    pushed = {path.name for path in remote.rglob("*") if path.is_file()}
    own = {path.name for path in Path(".dvc/cache").rglob("*") if path.is_file()}
    assert own and own <= pushed


def test_a_capture_that_still_changes_waits(project, monkeypatch):
    drop(project, range(2))
    growing = Path("data/inbox/s01s02/01/001/skeleton_pos.txt")

    def copy_on(_seconds: float) -> None:
        growing.write_text(growing.read_text() + "more")

    monkeypatch.setattr("flows.inbox.time", SimpleNamespace(sleep=copy_on))
    run = run_nightly()
    assert run.facts["accepted"] == ["s01s02/01/000"]
    assert run.facts["waiting"] == ["s01s02/01/001/skeleton_pos.txt"]


def _corrupt(path: Path) -> None:
    """Change bytes as a disk would: nobody wrote, so neither size nor time tell."""
    facts = path.stat()
    path.chmod(0o644)
    with path.open("r+b") as file:
        file.write(b"DATA")
    path.chmod(0o444)
    os.utime(path, ns=(facts.st_atime_ns, facts.st_mtime_ns))


def _running(words: str, folder: Path) -> bool:
    for place in Path("/proc").glob("[0-9]*"):
        try:
            line = (place / "cmdline").read_bytes().replace(b"\0", b" ").decode()
            if words in line and (place / "cwd").resolve() == folder:
                return True
        except OSError:
            continue
    return False
