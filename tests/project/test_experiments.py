"""What is trusted: the texts of the experiment files."""

import subprocess
from pathlib import Path

import pytest
from ruamel.yaml import YAML
from typer.testing import CliRunner

from pacmo_core.commands.cli import app
from pacmo_core.project.experiments import (
    ExperimentError,
    compose_params,
    remove_unused_outputs,
    use_experiment,
)
from pacmo_core.project.workspace import SAVED_PARAMS

DEFAULT = """\
# whole
experiment: default
runs: {folds: [1], seeds: [1], models: [gru]}
ingest:
  raw: data/raw   # made here
  settings: {fps: 30, gap: 2}
train:
  width: 4
"""


@pytest.fixture(autouse=True)
def project(tmp_path, monkeypatch):
    (tmp_path / "experiments").mkdir()
    (tmp_path / "params.yaml").write_text(DEFAULT)
    (tmp_path / "experiments" / "small.yaml").write_text("experiment: small\ntrain: {width: 1}\n")
    real = "experiment: real\ningest: {raw: '${captures}/real', settings: {rate: 15}}\n"
    (tmp_path / "experiments" / "real.yaml").write_text(real)
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PACMO_REAL_DATA", raising=False)
    return tmp_path


def load(text):
    return YAML(typ="safe").load(text)


def test_the_default_is_its_file_comments_and_all():
    assert "# made here" in compose_params("default")
    assert load(compose_params("default")) == load(DEFAULT)


def test_an_experiment_changes_what_it_says_and_nothing_else():
    composed = load(compose_params("small"))
    assert composed.pop("experiment") == "small"
    assert composed.pop("train") == {"width": 1}
    assert composed["ingest"] == load(DEFAULT)["ingest"]


PRIORS = "runs: {{priors: {{datasets: [{}]}}}}\ningest: {{dataset: mine}}\n"


@pytest.mark.parametrize("datasets", ["", "mine", "mine, other"])
def test_skeleton_priors_are_of_datasets_that_the_experiment_makes(project, datasets):
    second = "augment: {second_dataset: {dataset: other, format: bvh}}\n"
    text = f"{DEFAULT}augment: {{second_dataset: {{dataset: '', format: }}}}\n".replace(
        "models: [gru]}", "models: [gru], priors: {datasets: [default]}}"
    ).replace("ingest:\n", "ingest:\n  dataset: default\n")
    (project / "params.yaml").write_text(text)
    (project / "experiments" / "own.yaml").write_text(PRIORS.format(datasets) + second)
    assert load(compose_params("own"))["ingest"]["dataset"] == "mine"
    (project / "experiments" / "own.yaml").write_text("ingest: {dataset: mine}\n")
    said = "own.yaml: runs.priors.datasets has default, .* wanted mine, or"
    with pytest.raises(ExperimentError, match=said):
        compose_params("own")


def test_an_experiment_may_differ_from_another(project):
    (project / "experiments" / "tiny.yaml").write_text("from: small\nruns: {seeds: [4]}\n")
    wanted = load(compose_params("small"))
    wanted["runs"]["seeds"] = [4]
    assert load(compose_params("tiny")) == wanted


def test_experiments_that_differ_from_one_another_are_named(project):
    for name, other in (("one", "two"), ("two", "one")):
        (project / "experiments" / f"{name}.yaml").write_text(f"from: {other}\n")
    with pytest.raises(ExperimentError, match="circular base: one from two from one"):
        compose_params("one")


def test_a_key_that_the_default_lacks_is_refused_with_the_nearest(project):
    (project / "experiments" / "own.yaml").write_text("runs: {seed: [4]}\n")
    said = r"own.runs.seed: the default params.yaml has no such key \(did you mean seeds\?\)"
    with pytest.raises(ExperimentError, match=said):
        compose_params("own")


def test_captures_are_where_the_environment_says(project, monkeypatch):
    (project / "sets" / "real").mkdir(parents=True)
    monkeypatch.setenv("PACMO_REAL_DATA", str(project / "sets"))
    composed = load(compose_params("real"))["ingest"]
    assert composed == {"raw": str(project / "sets" / "real"), "settings": {"rate": 15}}


def test_captures_in_the_project_come_before_those_beside_it(project):
    (project / "data" / "captures" / "real").mkdir(parents=True)
    assert load(compose_params("real"))["ingest"]["raw"] == "data/captures/real"


def test_captures_that_are_not_at_hand_are_named(monkeypatch):
    monkeypatch.setenv("PACMO_REAL_DATA", "nowhere")
    with pytest.raises(ExperimentError, match="no captures in nowhere/real"):
        compose_params("real")


def test_a_key_that_the_default_lacks_is_named(project):
    (project / "experiments" / "odd.yaml").write_text("train: {wdth: 3}\n")
    with pytest.raises(ExperimentError, match=r"odd.train.wdth"):
        compose_params("odd")


def test_an_unknown_experiment_is_answered_with_what_there_is():
    with pytest.raises(ExperimentError, match="there are default, real, small"):
        compose_params("smal")


@pytest.mark.parametrize("text", ["experiment: small\ntrain: {width: [1\n", "", "- 1\n"])
def test_a_file_that_is_no_mapping_is_named_and_another_experiment_can_be_used(project, text):
    use_experiment("small")
    (project / "experiments" / "small.yaml").write_text(text)
    with pytest.raises(ExperimentError, match=r"experiments/small.yaml: (not YAML|wanted a map)"):
        use_experiment("small")
    assert load(Path("params.yaml").read_text())["experiment"] == "small"
    use_experiment("default")
    assert load(Path("params.yaml").read_text()) == load(DEFAULT)


def test_parameters_that_are_not_yaml_are_named(project):
    (project / "params.yaml").write_text("runs: [1\n")
    with pytest.raises(ExperimentError, match=r"params.yaml: not YAML: "):
        remove_unused_outputs()


def test_edited_parameters_are_saved_and_named(project):
    use_experiment("default")
    assert use_experiment("small") is None
    params = Path("params.yaml")
    edited = params.read_text().replace("width: 1", "width: 2")
    params.write_text(edited)
    saved = use_experiment("default")
    assert saved.parent == SAVED_PARAMS and saved.read_text() == edited
    assert params.read_text() == compose_params("default")
    params.write_text(edited)
    assert use_experiment("default") == saved  # the same edits are saved once


def test_parameters_that_differ_in_layout_alone_are_not_edited():
    use_experiment("small")
    params = Path("params.yaml")
    params.write_text(params.read_text().replace("   # made here", ""))
    assert use_experiment("default") is None


def commit(message):
    identity = ["-c", "user.name=x", "-c", "user.email=x@x"]
    for words in (["add", "-A"], [*identity, "commit", "-qm", message]):
        subprocess.run(["git", *words], check=True)


def test_the_defaults_are_those_committed_whatever_params_yaml_holds():
    subprocess.run(["git", "init", "-q"], check=True)
    commit("defaults")
    params = Path("params.yaml")
    params.write_text(DEFAULT.replace("width: 4", "width: 5"))
    assert load(compose_params("default"))["train"] == {"width": 4}
    params.write_text(compose_params("small"))
    commit("another experiment")
    assert compose_params("default") == DEFAULT
    params.write_text(DEFAULT.replace("width: 4", "width: 6"))
    commit("new defaults")
    assert load(compose_params("default"))["train"] == {"width": 6}


def test_without_git_the_defaults_outlive_another_experiment():
    use_experiment("small")
    assert compose_params("default") == DEFAULT


def test_parameters_of_an_unknown_origin_are_no_defaults(project):
    (project / "params.yaml").write_text("experiment: mine\n")
    with pytest.raises(ExperimentError, match="no default parameters"):
        compose_params("small")


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
    use_experiment("default")
    remove_unused_outputs()
    assert standing(project) == {
        name for name in made if "/2" not in name or name == "data/raw/2.skeleton"
    }


def test_tidying_goes_by_the_runs_in_the_parameters(project):
    made = outputs(project)
    (project / "params.yaml").write_text("runs: {folds: [2], seeds: [2], models: [gru]}\n")
    gone = {name for name in made if "/1" in name.replace("oracle/1", "oracle")}
    removed = remove_unused_outputs()
    assert standing(project) == made - gone and removed
    (project / "params.yaml").write_text("train: {}\n")
    with pytest.raises(ExperimentError, match="runs must have lists"):
        remove_unused_outputs()


def test_runs_on_variations_go_where_an_experiment_has_none(project):
    made = outputs(project)
    for place in ("models/1/{}/1/weights", "reports/curves/1/{}/1.csv", "data/reactions/1/{}/1/m"):
        path = project / place.format("pacmo_augmented")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    runs = "runs: {folds: [1, 2], seeds: [1, 2], models: [], variants: [gru]}\n"
    (project / "params.yaml").write_text(f"{runs}augmented: {{folds: [1], seeds: [1]}}\n")
    remove_unused_outputs()
    assert len(standing(project) - made) == 3
    (project / "params.yaml").write_text(f"{runs}augmented: {{folds: [], seeds: []}}\n")
    remove_unused_outputs()
    assert standing(project) == made


def test_models_that_the_parameters_no_longer_train_go(project):
    made = outputs(project)
    (project / "params.yaml").write_text("runs: {folds: [1, 2], seeds: [1, 2], models: [pacmo]}\n")
    remove_unused_outputs()
    assert standing(project) == {name for name in made if "gru" not in name}


def test_use_says_whether_what_it_removes_is_in_the_cache_and_what_brings_it_back(project):
    outputs(project)
    objects = project / ".dvc/cache/files/md5"
    digests = {"models/2": "aa" + 30 * "1", "data/splits/2": "bb" + 30 * "2"}
    (objects / "aa").mkdir(parents=True)
    (objects / "aa" / digests["models/2"][2:]).touch()
    lock = "".join(
        f"  s{number}:\n    outs:\n    - path: {path}\n      md5: {digest}\n"
        for number, (path, digest) in enumerate(digests.items())
    )
    (project / "dvc.lock").write_text(f"stages:\n{lock}")
    use_experiment("default")
    text = (project / "params.yaml").read_text()
    assert "experiment: default" in text
    said = CliRunner().invoke(app, ["use", "default"])
    assert said.exit_code == 0, said.output
    lines = {line.split()[1].rstrip(","): line for line in said.stdout.splitlines()}
    brings = "DVC's cache has it, ./run repro default brings it back"
    assert brings in next(line for path, line in lines.items() if path == "models/2")
    others = [line for path, line in lines.items() if path != "models/2"]
    assert others
    assert all("does not have all of it, ./run repro default makes it" in line for line in others)


@pytest.mark.parametrize("command", [["use", "nope"], ["tidy"], ["experiments"], ["status"]])
def test_outside_the_project_its_commands_make_nothing(tmp_path, monkeypatch, command):
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    said = CliRunner().invoke(app, command)
    assert said.exit_code == 1
    assert f"no dvc.yaml in {elsewhere}: wanted the folder of the project" in said.output
    assert not list(elsewhere.iterdir())
