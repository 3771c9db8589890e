"""What is trusted: the files that the stages leave, and DVC's own status."""

import json

import pytest
from dvc.utils.strictyaml import YAMLValidationError
from prefect.client.orchestration import get_client

from flows.reproduce import INGESTED, reproduce, say_what_was_quarantined
from pacmo_core.project.stages import upstream_and_stale

pytestmark = [
    pytest.mark.slow,
    pytest.mark.usefixtures("prefect_server"),
]


def spans(pipeline):
    lines = (pipeline / "spans.log").read_text().splitlines()
    return sorted(tuple(map(float, line.split())) for line in lines)


def test_the_flow_leaves_what_dvc_repro_would_and_then_has_nothing_to_do(pipeline):
    assert sorted(reproduce([])) == ["both", "left", "raw", "right"]
    assert (pipeline / "both.txt").read_text() == "first: 1 left.txt\nfirst: 1 right.txt\n"
    assert upstream_and_stale([])[1] == set()
    assert reproduce([]) == []


# In place of a stage's work: wait until the other stage of the same rank has started.
MEET = """\
Path(f"{sys.argv[2]}.started").touch()
other = {"left.txt": "right.txt", "right.txt": "left.txt"}[sys.argv[2]]
while not Path(f"{other}.started").exists():
    if time.monotonic() > start + 120:
        sys.exit("the other stage did not start")
    time.sleep(0.02)
"""


def test_stages_of_one_rank_run_side_by_side(pipeline):
    stage = pipeline / "stage.py"
    stage.write_text(stage.read_text().replace("time.sleep(1)\n", MEET))
    reproduce([])
    (_, first_end), (second_start, _) = spans(pipeline)
    assert second_start < first_end


def test_a_stage_that_fails_fails_the_flow(pipeline):
    (pipeline / "params.yaml").write_text("break: 1\n")
    with pytest.raises(Exception, match="broken on purpose"):
        reproduce([])
    assert not (pipeline / "both.txt").exists()


def test_what_a_stage_depends_on_and_is_not_there_is_named(pipeline):
    (pipeline / "stage.py").unlink()
    with pytest.raises(Exception, match=r"No such file or directory: '.*stage.py'"):
        reproduce([])


def test_captures_that_cannot_be_used_are_counted(tmp_path, monkeypatch, caplog):
    monkeypatch.chdir(tmp_path)
    INGESTED.parent.mkdir()
    for quarantined, said in ((0, []), (4, ["4 of 6 captures cannot be used"])):
        caplog.clear()
        INGESTED.write_text(json.dumps({"sequences_read": 6, "quarantined": quarantined}))
        with caplog.at_level("INFO"):
            say_what_was_quarantined()
        assert [line.message.partition(":")[0] for line in caplog.records] == said


def test_the_metrics_are_an_artifact_of_the_flow_run(pipeline):
    rows = {"pacmo": {"f2id": {"mean": 0.25, "low": 0.2, "high": 0.3}}}
    (pipeline / "reports").mkdir()
    metrics = {"experiment": "small", "data": {}, "pacmo": {"rows": rows}}
    (pipeline / "reports" / "details.json").write_text(json.dumps(metrics))
    (pipeline / "reports" / "report.html").write_text("<!doctype html>")
    with get_client(sync_client=True) as client:
        before = {found.id for found in client.read_artifacts()}  # flows of other tests
        reproduce(["raw"])
        artifacts = [found for found in client.read_artifacts() if found.id not in before]
    named = [found for found in artifacts if found.key]  # the others show progress
    assert {found.key: bool(found.description) for found in named} == {
        "metrics": True,
        "report": True,
    }
    (text,) = (found.data for found in artifacts if str(found.data).startswith("# small"))
    assert "0.25" in text


@pytest.mark.parametrize("share", [0, 0.3, 0.6])
def test_a_lock_that_a_kill_cut_short_costs_nothing_that_was_made(pipeline, share):
    reproduce([])
    lock, ran = pipeline / "dvc.lock", spans(pipeline)
    whole = lock.read_text()
    lock.write_text(whole[: int(share * len(whole))])
    reproduce([])
    assert sorted(lock.read_text().splitlines()) == sorted(whole.splitlines())
    assert spans(pipeline) == ran
    assert reproduce([]) == []


def test_another_file_that_dvc_cannot_read_is_for_its_owner(pipeline):
    (pipeline / "dvc.yaml").write_text("stages: 3\n")
    with pytest.raises(YAMLValidationError, match=r"dvc\.yaml"):
        reproduce([])
    assert (pipeline / "dvc.yaml").exists()
