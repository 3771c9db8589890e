"""What is trusted: the texts of the experiment files."""

from pathlib import Path

import pytest
from ruamel.yaml import YAML

from apps.experiments import ExperimentError, compose, tidy, use

DEFAULT = """\
# whole
experiment: default
runs: {folds: [1], seeds: [1]}
ingest:
  raw: data/raw   # made here
  settings: {fps: 30, gap: 2}
train:
  width: 4
"""


@pytest.fixture(autouse=True)
def project(tmp_path, monkeypatch):
    (tmp_path / "experiments").mkdir()
    (tmp_path / "experiments" / "default.yaml").write_text(DEFAULT)
    (tmp_path / "experiments" / "small.yaml").write_text("experiment: small\ntrain: {width: 1}\n")
    real = "experiment: real\ningest: {raw: '${captures}/real', settings: {rate: 15}}\n"
    (tmp_path / "experiments" / "real.yaml").write_text(real)
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PACMO_REAL_DATA", raising=False)
    return tmp_path


def load(text):
    return YAML(typ="safe").load(text)


def test_the_default_is_its_file_comments_and_all():
    assert "# made here" in compose("default")
    assert load(compose("default")) == load(DEFAULT)


def test_an_experiment_changes_what_it_says_and_nothing_else():
    composed = load(compose("small"))
    assert composed.pop("experiment") == "small"
    assert composed.pop("train") == {"width": 1}
    assert composed["ingest"] == load(DEFAULT)["ingest"]


def test_an_experiment_may_differ_from_another(project):
    (project / "experiments" / "tiny.yaml").write_text("from: small\nruns: {seeds: [4]}\n")
    wanted = load(compose("small"))
    wanted["runs"]["seeds"] = [4]
    assert load(compose("tiny")) == wanted


def test_experiments_that_differ_from_one_another_are_named(project):
    for name, other in (("one", "two"), ("two", "one")):
        (project / "experiments" / f"{name}.yaml").write_text(f"from: {other}\n")
    with pytest.raises(ExperimentError, match="one from two from one has no beginning"):
        compose("one")


def test_captures_are_where_the_environment_says(project, monkeypatch):
    (project / "sets" / "real").mkdir(parents=True)
    monkeypatch.setenv("PACMO_REAL_DATA", str(project / "sets"))
    composed = load(compose("real"))["ingest"]
    assert composed == {"raw": str(project / "sets" / "real"), "settings": {"rate": 15}}


def test_captures_in_the_project_come_before_those_beside_it(project):
    (project / "data" / "captures" / "real").mkdir(parents=True)
    assert load(compose("real"))["ingest"]["raw"] == "data/captures/real"


def test_captures_that_are_not_at_hand_are_named(monkeypatch):
    monkeypatch.setenv("PACMO_REAL_DATA", "nowhere")
    with pytest.raises(ExperimentError, match="no captures in nowhere/real"):
        compose("real")


def test_a_key_that_the_default_lacks_is_named(project):
    (project / "experiments" / "odd.yaml").write_text("train: {wdth: 3}\n")
    with pytest.raises(ExperimentError, match=r"odd.train.wdth"):
        compose("odd")


def test_an_unknown_experiment_is_answered_with_what_there_is():
    with pytest.raises(ExperimentError, match="there are default, real, small"):
        compose("smal")


def test_edits_by_hand_are_not_lost_unless_asked(project):
    use("default", discard=False)
    use("small", discard=False)
    params = Path("params.yaml")
    params.write_text(params.read_text().replace("width: 1", "width: 2"))
    with pytest.raises(ExperimentError, match="edits that no experiment has"):
        use("default", discard=False)
    assert "width: 2" in params.read_text()
    use("default", discard=True)
    assert params.read_text() == compose("default")


def outputs(root):
    """Lay out what two folds and two seeds leave; the oracle has one run, whatever the seeds."""
    names = ["data/splits/{}.parquet", "data/scores/{}.parquet", "reports/split/{}.json"]
    names += ["models/{}/autoencoder/weights", "reports/curves/{}/autoencoder.csv"]
    names += ["models/{}/gru/1/weights", "models/{}/gru/2/weights", "reports/curves/{}/gru/2.csv"]
    names += ["data/reactions/{}/oracle/1/motions", "data/reactions/{}/gru/2/motions"]
    found = {name.format(fold) for name in names for fold in (1, 2)} | {"data/raw/2.skeleton"}
    for name in found:
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).touch()
    return found


def standing(root):
    below = [p for place in ("data", "models", "reports") for p in (root / place).rglob("*")]
    return {str(path.relative_to(root)) for path in below if path.is_file()}


def test_what_other_folds_and_seeds_left_goes_when_an_experiment_is_taken_up(project):
    made = outputs(project)
    use("default", discard=False)
    assert standing(project) == {
        name for name in made if "/2" not in name or name == "data/raw/2.skeleton"
    }


def test_tidying_goes_by_the_runs_in_the_parameters(project):
    made = outputs(project)
    (project / "params.yaml").write_text("runs: {folds: [2], seeds: [2]}\n")
    gone = {name for name in made if "/1" in name.replace("oracle/1", "oracle")}
    removed = tidy()
    assert standing(project) == made - gone and removed
    (project / "params.yaml").write_text("train: {}\n")
    with pytest.raises(ExperimentError, match="wanted runs"):
        tidy()


def test_runs_on_variations_go_where_an_experiment_has_none(project):
    made = outputs(project)
    for place in ("models/1/{}/1/weights", "reports/curves/1/{}/1.csv", "data/reactions/1/{}/1/m"):
        path = project / place.format("pacmo_augmented")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    runs = "runs: {folds: [1, 2], seeds: [1, 2]}\n"
    (project / "params.yaml").write_text(f"{runs}augmented: {{folds: [1], seeds: [1]}}\n")
    tidy()
    assert len(standing(project) - made) == 3
    (project / "params.yaml").write_text(f"{runs}augmented: {{folds: [], seeds: []}}\n")
    tidy()
    assert standing(project) == made
