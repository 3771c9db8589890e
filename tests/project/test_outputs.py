"""What is trusted: the files' own names."""

import shutil
from pathlib import Path

from ruamel.yaml import YAML

from pacmo_core.project.experiments import remove_unused_outputs
from pacmo_core.project.outputs import ExpectedPriors, unused_prior_outputs

ROOT = Path(__file__).parents[2]
WANTED = ExpectedPriors(["duo"], ["random", "random_6"], ["m_gcn"], [1, 2])
KEPT = [
    "data/priors/splits/.gitignore",
    "data/priors/splits/duo/random.parquet",
    "data/priors/scores/duo/random_6.json",
    "models/priors/duo/random/m_gcn/1/weights.safetensors",
    "models/priors/duo/random/m_gcn/.gitignore",
    "reports/curves/priors/duo/random_6/m_gcn/2.csv",
]
LEFT = {
    "data/priors/samples/cmu/random.parquet": "data/priors/samples/cmu",
    "data/priors/scores/duo/cross_scale.json": "data/priors/scores/duo/cross_scale.json",
    "models/priors/duo/random/m_gcn/3/weights.safetensors": "models/priors/duo/random/m_gcn/3",
    "models/priors/duo/random/f_cnn/1/weights.safetensors": "models/priors/duo/random/f_cnn",
    "reports/curves/priors/duo/random/m_gcn/3.csv": "reports/curves/priors/duo/random/m_gcn/3.csv",
}


def test_priors_that_the_parameters_do_not_make_are_left_over_and_no_others(tmp_path):
    for name in [*KEPT, *LEFT]:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    found = {str(path.relative_to(tmp_path)) for path in unused_prior_outputs(tmp_path, WANTED)}
    assert found == set(LEFT.values())


def test_where_no_priors_are_wanted_all_are_left_over(tmp_path):
    for name in KEPT:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    found = list(unused_prior_outputs(tmp_path, ExpectedPriors([], [], [], [])))
    assert {path.name for path in found} == {"duo"}
    assert not list(unused_prior_outputs(Path(tmp_path / "nowhere"), WANTED))


def test_what_the_default_makes_is_kept(tmp_path, monkeypatch):
    stages = YAML(typ="safe").load(ROOT / "dvc.lock")["stages"]
    made = {out["path"] for stage in stages.values() for out in stage["outs"]}
    assert "data/reactions/1/pacmo_without_finish/1" in made
    for name in [*made, "data/reactions/1/gru_without_finish/1"]:
        (tmp_path / name).mkdir(parents=True)
    shutil.copy(ROOT / "params.yaml", tmp_path)
    monkeypatch.chdir(tmp_path)
    assert remove_unused_outputs() == [Path("data/reactions/1/gru_without_finish/1")]
