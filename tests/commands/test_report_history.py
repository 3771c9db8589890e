"""Truth: the metrics, the lock and the study that were put there."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from pacmo_core.commands.cli import app
from pacmo_core.commands.report import read_measured
from pacmo_core.commands.study import count_answers
from pacmo_core.commands.study_store import Study
from pacmo_core.figures import render_report
from tests.commands.studies import small_study
from tests.figures.samples import cell, report

LOCK = """\
stages:
  cut:
    cmd: python -m stages.cut data/sequences data/clips
    deps: [{path: data/sequences, md5: 0123.dir}]
    outs: [{path: data/clips, md5: 4567.dir}]
"""
HISTORY = Path("history/measured.jsonl")


@pytest.fixture(autouse=True)
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stand where a run has ended."""
    monkeypatch.chdir(tmp_path)
    Path("reports").mkdir()
    Path("reports/report.html").write_text(render_report(report()))
    Path("dvc.lock").write_text(LOCK)
    measure(0.5)


def measure(f2id: float) -> None:
    facts = {"experiment": "default", "pacmo": {"rows": {"pacmo": {"f2id": cell(f2id)}}}}
    Path("reports/details.json").write_text(json.dumps(facts))


def write() -> str:
    done = CliRunner().invoke(app, ["report"])
    assert done.exit_code == 0, done.output
    return Path(done.stdout.strip()).read_text()


def test_a_run_is_remembered_once_and_an_older_one_stays() -> None:
    for f2id in (0.5, 0.5, 0.25, 0.5):
        measure(f2id)
        page = write()
    runs = read_measured(HISTORY)
    assert [(run.number, run.metrics["f2id"]["mean"]) for run in runs] == [(1, 0.5), (2, 0.25)]
    assert "0.250" in page
    assert "default: metrics of all runs" in page


def test_every_command_stands_there_with_its_hashes() -> None:
    page = write()
    for text in ("python -m stages.cut data/sequences data/clips", "0123.dir", "4567.dir"):
        assert text in page
    assert "./run repro default" in page


def test_a_study_stands_there_when_it_has_been_counted(tmp_path: Path) -> None:
    assert 'id="study"' not in write()
    study = Study(small_study(tmp_path / "s.sqlite"))
    for name in ("ann", "bob"):
        study.begin(name, lambda seen: [c.item for c in seen[:14]], 9)
        for place in range(14):
            study.answer(name, place, real=place % 7 > 0)
    done = CliRunner().invoke(app, ["study", "report", "s.sqlite", "--out", "history/study.json"])
    assert done.exit_code == 0, done.output
    found = count_answers(study.answers())
    assert (found["real"]["real"]["count"], found["generated"]["real"]["count"]) == (12, 12)
    page = write()
    assert "), 12 of 14</td><td>0.81</td><td>0.75</td>" in page
    assert "those of another run" in page


def test_without_a_run_there_is_one_line() -> None:
    Path("reports/report.html").unlink()
    done = CliRunner().invoke(app, ["report"])
    assert (done.exit_code, done.stderr.count("\n")) == (1, 1)
